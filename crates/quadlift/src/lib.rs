//! quadlift lifts 2D object detections from posed images to 3D objects.
#![forbid(unsafe_code)]

pub mod geometry;
