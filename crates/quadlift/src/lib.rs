//! Lifts 2D object detections from posed images to 3D objects: where each object is, how big, how it is turned, and how
//! sure that is. No training, no GPU.
//!
//! ```
//! use nalgebra::Matrix3x4;
//! use quadlift::geometry::{BoundingBox, CamFromWorld, Intrinsics, Projection};
//! use quadlift::scene::{NewDetection, SceneBuilder};
//! use quadlift::{LocalizeOptions, localize};
//!
//! let camera = Intrinsics::new(500.0, 500.0, 320.0, 240.0)?;
//! let mut builder = SceneBuilder::new("a cup on a table");
//! // Four images from the left to the right, 5 m before the cup, and its box in each.
//! for (frame, x) in [("a.jpg", -1.5), ("b.jpg", -0.5), ("c.jpg", 0.5), ("d.jpg", 1.5)] {
//!     let cam_from_world = Matrix3x4::new(1.0, 0.0, 0.0, -x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 5.0);
//!     let projection = Projection::from_camera(&camera, &CamFromWorld::new(cam_from_world)?);
//!     builder.add_frame(frame, projection, Some([640.0, 480.0]))?;
//!     let u = 320.0 - 100.0 * x;
//!     let bounding_box = Some(BoundingBox::new([u - 50.0, 190.0, u + 50.0, 290.0])?);
//!     builder.add_detection(&NewDetection { frame, object: Some("cup"), bounding_box, ..Default::default() })?;
//! }
//! let result = localize(&builder.build(), &LocalizeOptions::default())?;
//! let cup = &result.estimates[0];
//! println!("{}: at {:?}, {:?}", cup.status.name(), cup.center, cup.body);
//! assert!(cup.center.unwrap().coords.norm() < 0.3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - **A scene**: [`scene::SceneBuilder`] checks posed frames and detections; [`localize()`] gives an
//!   [`Estimate`](solve::Estimate) for every object: a body (ellipsoid, cuboid, cylinder or superellipsoid), its covariance,
//!   the residual of each view, outliers and warnings. A [`Status`](solve::Status) other than `Ok` says why there is none.
//! - **No object ids**: [`associate()`] divides the detections into objects and clutter.
//! - **All steps in order**: [`run()`] checks a scene, associates its detections, and localizes its objects, as the program does.
//! - **Frame by frame**: [`online::ObjectMap`] keeps a map of objects while frames arrive.
//! - **One object, no scene**: [`solve::Estimator`] fits the [`View`](scene::View)s of one object by any method.
//! - **Wrong input**: [`diagnosis::diagnose`] checks whether a scene agrees with itself, and names the mistake (pose
//!   convention, resized boxes, shifted frames, ...). [`localize()`] calls it, and reports no object as `Ok` where it does not.
//! - **How good**: [`metrics`] compare estimates with a truth; [`cross_validation`] needs none.
//! - **Test data**: [`synthetic::generate`] makes scenes with a known truth.
//!
//! | [`Method`](solve::Method) | Measurements | Views | Covariance | One object in 20 views | Source |
//! | --- | --- | --- | --- | --- | --- |
//! | `posterior` (default) | boxes, ellipses, masks | 2 | yes | 1.6 ms; ellipsoids only: 0.2 to 0.5 ms | docs/method.md, sections 5 to 12 |
//! | `planes` | boxes, masks | 3 | no | 0.1 ms | docs/method.md, section 4.4 |
//! | `lfd` | ellipses, or those inscribed in boxes | 3 | no | 26 us | LfD (TPAMI 2017) |
//! | `pfd` | ellipses, or those inscribed in boxes | 3 | no | 9 us | *3D Pose from Detections*, section 3 |
//! | `reg` | ellipses, or those inscribed in boxes | 2 | no | 20 us | *3D Pose from Detections*, section 4.1 |
//!
//! World lengths are in any unit; pixels have their origin at the corner of the first pixel; cameras look along +z with y
//! down ([`geometry::CamFromWorld`]). Points and matrices are [`nalgebra`]'s, which is re-exported. The library reads no
//! files (the crate `quadlift-io` does) and prints nothing; results do not depend on the number of threads.
//!
//! # Features
//! `parallel` (default): objects are solved in parallel with rayon.
//! `serde`: an object map ([`online::ObjectMap`]) can be written and read, to go on later; `quadlift-io` has its files.
#![forbid(unsafe_code)]

mod observer;
mod parallel;
mod sorting;
#[cfg(not(feature = "sensitivity"))]
mod tuning;
#[cfg(feature = "sensitivity")]
#[doc(hidden)]
pub mod tuning;
pub mod random;
pub mod geometry;
mod optimize;
mod body_model;
pub mod scene;
pub mod solve;
pub mod cross_validation;
pub mod association;
pub mod diagnosis;
pub mod metrics;
pub mod calibrate_rig;
mod localize;
mod names;
pub mod run;
pub mod relocalize;
pub mod align;
pub mod online;
pub mod synthetic;

pub use association::{associate, associate_observed};
pub use localize::{Localization, LocalizeError, LocalizeOptions, MeasurementKind};
pub use names::UnknownName;
pub use observer::{Observer, Phase, Unobserved, Watch};
pub use run::{localize, localize_observed, run};
// Its types are part of this API.
pub use nalgebra;

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod test_cases;
