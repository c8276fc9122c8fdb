//! What pictures are drawn with: a camera, triangles and their light, and words on top.

pub mod camera;
pub mod canvas;
pub mod colour;
mod hollow;
pub mod light;
pub mod raster;
pub mod solid;
