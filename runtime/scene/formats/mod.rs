//! Reads the pixels of pictures, videos and maps as linear light or as stored values.

pub(crate) mod decoded;
pub(crate) mod decoder;
pub(crate) mod halves;
pub(crate) mod options;
pub(crate) mod pfm;
pub(crate) mod picture;
pub(crate) mod png_tone;
pub(crate) mod still;
pub(crate) mod tone;
pub(crate) mod video;
pub(crate) mod video_color;
pub(crate) mod y4m;
