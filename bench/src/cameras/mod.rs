//! Cameras from objects (ours): images located in a map of objects, in synthetic rooms and on real scenes; maps that are aligned;
//! poses that are refined with the objects; rigs of fixed cameras from people who walk by.

pub(crate) mod alignment;
pub(crate) mod calibration;
mod centers;
mod eight_point;
pub(crate) mod images;
mod point_pairs;
mod p3p;
mod real;
mod refinement;
pub(crate) mod rooms;
mod triples;

use std::path::Path;

use crate::data::data_folder;
use crate::error::Error;
use crate::progress::Run;
use crate::report::Report;

/// Runs the experiment; `data` is the folder of the real data, without which that part is left out.
///
/// # Errors
/// [`Error`]: a file that is wrong.
pub(crate) fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let mut report = Report::new("cameras", "Cameras from objects");
    rooms::run(run, &mut report)?;
    alignment::run(run, &mut report)?;
    refinement::run(run, &mut report)?;
    calibration::run(run, &mut report)?;
    match data_folder(data) {
        Ok(folder) => {
            real::run(&folder, run, &mut report)?;
            alignment::run_real(&folder, run, &mut report)?;
            refinement::run_real(&folder, run, &mut report)?;
        }
        Err(Error::NoData(_)) => {
            report.text("Without the real data LINEMOD Occlusion and TUW are left out.".to_owned())
        }
        Err(error) => return Err(error),
    }
    Ok(report)
}
