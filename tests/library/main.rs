//! Tests of the library across its modules, on the CPU and on a Vulkan device, against float64 and with damaged input.

mod architecture;
mod contents;
mod encode_steady;
mod extremes;
mod eyes;
mod facade;
mod far_field;
mod forward;
mod fuzz;
mod header;
mod mask;
mod methods;
mod model;
mod motion;
mod photographs;
mod picture;
mod reference;
mod solver_and_model;
mod source;
mod sources;
mod splats;
mod steering;
mod tiled_model;
