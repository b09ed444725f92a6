//! Parquet, if the program was built with it.

#[cfg(feature = "parquet")]
use quadlift_io::tables::write_tables;

use super::Common;
use crate::error::Outcome;
use crate::output::Output;

#[cfg(feature = "parquet")]
pub(super) fn run(common: &Common, out: &Output) -> anyhow::Result<Outcome> {
    let Common { scene, output } = common;
    let (file, _) = crate::files::read_scene(scene)?;
    file.to_objects().map_err(|error| error.in_file(scene))?;
    let counts = write_tables(output, &file)?;
    let notes: &[String] = &[];
    super::tell(out, std::iter::once((output.as_path(), counts.as_slice(), notes)), None)
}

#[cfg(not(feature = "parquet"))]
pub(super) fn run(_: &Common, _: &Output) -> anyhow::Result<Outcome> {
    crate::error::usage(crate::words::NO_PARQUET)
}
