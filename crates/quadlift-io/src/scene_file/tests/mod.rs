//! Tests of the scene file as a whole.

mod images;
mod messages;
mod outlines;
mod real_data;
mod round_trip;
