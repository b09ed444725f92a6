//! The object map frame by frame: beside association of all frames at once, objects that are taken away, loop closures (ours).

mod beside_batch;
mod lifecycle;
mod loop_closure;
mod over_time;
pub(crate) mod replay;

use std::path::Path;

use crate::data::data_folder;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;

/// Runs the experiment. Without real data the synthetic scenes remain, unless `data` names a folder that has none.
///
/// # Errors
/// [`Error::NoData`], [`Error::Read`], [`Error::Synthetic`], [`Error::Associate`], [`Error::Localize`].
pub(crate) fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let folder = match data_folder(data) {
        Ok(folder) => Some(folder),
        Err(error) if data.is_some() => return Err(error),
        Err(_) => None,
    };
    let steps = Steps::new("online", 3, run.progress);
    let mut report = Report::new("online", "The object map frame by frame");
    report.text(
        "Scenes are observed frame by frame by `quadlift::online::ObjectMap`, without object ids and with its default options. F1 \
         and O3D are those of `quadlift-bench association`; O3D is that of `localize` on the views that the map keeps (32 of each \
         object at most).",
    );
    beside_batch::add(folder.as_deref(), &mut report, run)?;
    steps.done();
    lifecycle::add(&mut report, run)?;
    steps.done();
    loop_closure::add(&mut report, run)?;
    steps.done();
    Ok(report)
}
