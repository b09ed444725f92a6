//! quadlift lifts 2D object detections from posed images to 3D objects.
//!
//! A [`scene::Scene`] holds posed frames and the detections in them; [`localize()`] gives an estimate for every object
//! that the detections name: an ellipsoid, a cuboid or a superellipsoid, with its uncertainty and residuals. Where the
//! detections name no objects, [`associate()`] finds out which of them show the same one.
//!
//! ```
//! use quadlift::synthetic::{Noise, Observations, SyntheticOptions, generate};
//! use quadlift::{LocalizeOptions, localize};
//!
//! // Three objects in 20 views, and boxes with noise; `scene::SceneBuilder` builds a scene from your own data.
//! let synthetic = generate(&SyntheticOptions {
//!     objects: 3,
//!     observations: Observations::Boxes,
//!     noise: vec![Noise::BoxEdges(0.02)],
//!     ..Default::default()
//! })?;
//! let result = localize(&synthetic.scene, &LocalizeOptions::default())?;
//! for (estimate, (id, _truth)) in result.estimates.iter().zip(&synthetic.truth) {
//!     println!("{id}: {}, {:?}", estimate.status.name(), estimate.ellipsoid());
//!     assert!(estimate.body.is_some());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Each folder uses only those above it in this order: [`geometry`] (the vocabulary), [`scene`] (what users bring),
//! [`solve`] (the method), [`cross_validation`] (how well views that were left out are predicted), [`association`]
//! (objects from detections that name none), [`diagnosis`] (does a scene agree with itself), [`metrics`] (how good an
//! estimate is), [`synthetic`] (scenes with known truth), and [`localize()`], the one call. The library reads no files and
//! prints nothing.
#![forbid(unsafe_code)]

pub mod association;
mod body_model;
pub mod cross_validation;
pub mod diagnosis;
pub mod geometry;
mod localize;
pub mod metrics;
mod names;
mod observer;
mod optimize;
mod parallel;
pub mod scene;
pub mod solve;
pub mod synthetic;

pub use association::{associate, associate_observed};
pub use localize::{
    Localization, LocalizeError, LocalizeOptions, MeasurementKind, OptionError, localize, localize_observed,
};
pub use names::UnknownName;
pub use observer::Observer;
// Its types are part of this API.
pub use nalgebra;
