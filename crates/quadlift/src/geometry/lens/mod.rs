//! Cameras with lens distortion: COLMAP's models. Measurements are undistorted, not images: a distorted pixel becomes
//! the pixel in which an ideal pinhole camera with the same axes, focal lengths and principal point would see the same
//! point. The solvers see nothing but pinhole cameras.

mod distortion;
mod camera;
mod measurements;

#[cfg(test)]
mod tests;

pub use camera::Camera;
