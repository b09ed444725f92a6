//! A scene as Parquet tables: a folder with a file for each kind of record, for pandas, polars, Spark and the like.
//!
//! `columns` maps entries of records to columns. Fields without a column (unknown fields) are kept as JSON in the
//! column `extra`, so that scene -> tables -> scene is the identity. The records go through their JSON form, which is
//! what defines them.

mod columns;
mod read;
mod values;
mod write;

#[cfg(test)]
mod tests;

pub use read::read_tables;
pub use write::write_tables;
