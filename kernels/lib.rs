//! The compute kernels: GLSL source and, beside each, its CPU twin in Rust.
