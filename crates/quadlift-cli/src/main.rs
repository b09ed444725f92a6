//! The program `quadlift`.
#![forbid(unsafe_code)]
fn main() {}
