//! `--coverage`: regions calibrated on earlier results.

use std::path::{Path, PathBuf};

use quadlift_io::coverage::{CoverageRecord, coverage};
use quadlift_io::{SceneFile, read_scene_file};

use crate::words::count;

/// The requested calibration in the format of results.
pub(super) fn read_coverage(paths: &[PathBuf]) -> anyhow::Result<Option<CoverageRecord>> {
    if paths.is_empty() {
        return Ok(None);
    }
    let files = paths.iter().map(|path| read_scene_file(path)).collect::<Result<Vec<_>, _>>()?;
    let files: Vec<(&Path, &SceneFile)> = paths.iter().map(PathBuf::as_path).zip(&files).collect();
    let pairs: Vec<[(&Path, &SceneFile); 2]> = files.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
    let found = coverage(&pairs)?;
    let names: Vec<[&Path; 2]> = pairs.iter().map(|[result, truth]| [result.0, truth.0]).collect();
    Ok(Some(CoverageRecord::of(&found, &names)))
}

/// The calibration in one line.
pub(super) fn coverage_in_words(record: &CoverageRecord) -> String {
    // The quantile of chi-square with 3 degrees of freedom.
    let said = match record.squared_distance.center.p95 {
        Some(limit) => format!("the 95 % region of a center ends at a squared distance of {limit:.2} instead of 7.81"),
        None => "too few for a 95 % region".to_owned(),
    };
    format!("regions calibrated on {}: {said}\n", count(record.objects, "object"))
}
