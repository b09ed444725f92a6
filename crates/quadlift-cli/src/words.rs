//! Small pieces of text that several reports share.

pub use quadlift_io::wording::{count, some_of};

/// What is said where Parquet is asked for and the program was built without it.
#[cfg(not(feature = "parquet"))]
pub const NO_PARQUET: &str = "this program was built without Parquet; build it with it: cargo install --path crates/quadlift-cli \
                              --features parquet";

/// A title of a column with lengths; the unit is named where it is known.
pub fn with_unit(title: &str, length_unit: Option<&str>) -> String {
    match length_unit {
        Some(unit) => format!("{title} [{unit}]"),
        None => title.to_owned(),
    }
}
