//! Reads folders, arrays, pictures of many views and focal stacks, with the order and positions of their cameras.

pub(crate) mod admit;
pub(crate) mod array;
pub(crate) mod capture;
pub(crate) mod eyes;
pub(crate) mod folder;
pub(crate) mod frames;
pub(crate) mod identity;
pub(crate) mod inspect;
pub(crate) mod layout;
pub(crate) mod mosaic;
pub(crate) mod mosaic_grid;
pub(crate) mod moving_splats;
pub(crate) mod names;
pub(crate) mod numbers;
pub(crate) mod order_found;
pub(crate) mod planes;
pub(crate) mod positions;
pub(crate) mod repeats;
pub(crate) mod settings;
pub(crate) mod single;
pub(crate) mod source;
pub(crate) mod splats;
pub(crate) mod stack;
pub(crate) mod standing;
pub(crate) mod views;
