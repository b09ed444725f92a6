//! The library as its users call it. One binary for all files: each would compile the same numerics.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod accuracy;
mod alternatives;
mod closed_forms;
mod common;
mod cross_validation;
mod cues;
mod evidence;
mod false_boxes;
mod invariance;
mod learned_sizes;
mod lens;
mod masks;
mod observer;
mod pfd_reference;
mod refined_poses;
mod noise_model;
mod surroundings;
#[path = "../../src/test_cases.rs"]
mod test_cases;
mod trust;
mod upright;
