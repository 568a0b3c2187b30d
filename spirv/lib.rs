//! The compiled modules, embedded, with the manifest of their sources.
