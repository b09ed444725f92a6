//! A scene as Parquet tables: a folder with a file for each kind of record, for pandas, polars, Spark and the like.
//!
//! `columns` maps entries of records to columns. Fields without a column (unknown fields) are kept as JSON in the
//! column `extra`, so that scene -> tables -> scene is the identity. The records go through their JSON form, which is
//! what defines them.

mod columns;
mod values;
mod read;
mod write;

#[cfg(test)]
mod tests;

pub use read::read_tables;
pub use write::write_tables;

use crate::read::{Format, PoseFormat};

/// The row of this format. Tables are not recognized: name it.
pub(crate) const FORMAT: PoseFormat = Format {
    name: "parquet",
    title: "Parquet",
    about: "Tables of `quadlift export parquet`, converted back to a scene",
    looks: "",
    options: &[],
    finds: |probe| probe.when(false),
    read: |path, _| {
        // The reader turns panics of the crate parquet on damaged files into errors: say it once, not twice.
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| {}));
        let import = read_tables(path);
        std::panic::set_hook(hook);
        import
    },
};
