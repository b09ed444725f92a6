//! Files in and out of quadlift.
#![forbid(unsafe_code)]
