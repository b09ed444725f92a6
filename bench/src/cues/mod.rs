//! Depths and 3D boxes of single images beside boxes (ours): simulated on synthetic scenes and on KITTI; depths with a scale in each
//! frame, and with a shift; points of structure from motion; outlines and oriented boxes: simulated, on rendered scenes and on real images;
//! sizes that are learned from the scene.

mod frame_scales;
mod fusion;
mod kitti;
mod occlusion;
mod one_view;
mod outlines;
mod points;
mod shifts;
mod sizes;
mod synthetic;

use std::path::Path;

use crate::data::data_folder;
use crate::error::Error;
use crate::progress::Run;
use crate::report::Report;

/// Runs the experiment; `data` is the folder of the real data, without which the part on KITTI is left out.
///
/// # Errors
/// [`Error`]: a file that is wrong.
pub(crate) fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let mut report = Report::new("cues", "Depths and 3D boxes beside boxes");
    synthetic::run(run, &mut report)?;
    one_view::run(run, &mut report)?;
    frame_scales::run(run, &mut report)?;
    shifts::run(run, &mut report)?;
    points::run(run, &mut report)?;
    sizes::run(run, &mut report)?;
    let folder = match data_folder(data) {
        Ok(folder) => Some(folder),
        Err(Error::NoData(_)) => None,
        Err(error) => return Err(error),
    };
    match &folder {
        Some(folder) => {
            kitti::run(folder, run, &mut report)?;
            sizes::run_real(folder, run, &mut report)?;
        }
        None => report.text("Without the real data KITTI and real images are left out.".to_owned()),
    }
    outlines::run(run, &mut report)?;
    occlusion::run(folder.as_deref(), run, &mut report)?;
    Ok(report)
}
