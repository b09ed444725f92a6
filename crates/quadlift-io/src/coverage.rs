//! Regions calibrated on results with known truth: from files to limits, and their record in a result.

use std::path::Path;

use quadlift::geometry::Body;
use quadlift::metrics::{Coverage, RegionPart, SquaredErrors, squared_errors};
use quadlift::solve::Status;
use serde::{Deserialize, Serialize};

use crate::error::{EntryError, ReadError};
use crate::scene_file::{ObjectBodies, SceneFile};

/// Calibrates regions on the objects of results with their ground truth, each with its path; estimates and true objects are paired by their ids.
/// Only estimates that are `ok` and have a covariance count.
///
/// # Errors
/// [`ReadError`] when a file is wrong, or a result shares no such object with its truth.
pub fn coverage(pairs: &[[(&Path, &SceneFile); 2]]) -> Result<Coverage, ReadError> {
    let mut errors = Vec::new();
    for [(result_path, result), (truth_path, truth)] in pairs {
        let estimates = result.to_objects().map_err(|error| error.in_file(result_path))?;
        let truths = truth.to_objects().map_err(|error| error.in_file(truth_path))?;
        let known: Vec<SquaredErrors> = estimates
            .iter()
            .filter_map(|estimate| errors_of(estimate, truths.iter().find(|truth| truth.id == estimate.id)?))
            .collect();
        if known.is_empty() {
            let problem = format!(
                "no object that is \"ok\" and has a covariance has the id of an object of {}",
                truth_path.display()
            );
            return Err(EntryError::new("objects", problem).in_file(result_path));
        }
        errors.extend(known);
    }
    Ok(Coverage::new(&errors))
}

fn errors_of(estimate: &ObjectBodies, truth: &ObjectBodies) -> Option<SquaredErrors> {
    if estimate.status != Some(Status::Ok) {
        return None;
    }
    let body = estimate.body()?;
    let cuboid = truth.cuboid().filter(|cuboid| cuboid.kind == body.kind);
    let true_body = cuboid.or(truth.ellipsoid().map(Body::from)).or(truth.body())?;
    squared_errors(&body, &estimate.covariance?, &true_body)
}

/// A calibration in a result file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct CoverageRecord {
    /// How limits are found.
    pub method: String,
    /// Number of objects whose truth is known.
    pub objects: usize,
    /// The results.
    pub results: Vec<String>,
    /// What replaces the quantiles of chi-square.
    pub squared_distance: RegionsRecord,
    /// The scenes with their ground truth.
    pub truths: Vec<String>,
}

/// For each part of an estimate the squared distance at which its regions end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RegionsRecord {
    /// The whole body.
    pub body: LimitsRecord,
    /// The center.
    pub center: LimitsRecord,
    /// The extents.
    pub extents: LimitsRecord,
}

/// The squared distances at which the regions of a part end, by level; `None` where there are too few objects.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LimitsRecord {
    /// 50 %.
    #[serde(rename = "0.5")]
    pub p50: Option<f64>,
    /// 90 %.
    #[serde(rename = "0.9")]
    pub p90: Option<f64>,
    /// 95 %.
    #[serde(rename = "0.95")]
    pub p95: Option<f64>,
    /// 99 %.
    #[serde(rename = "0.99")]
    pub p99: Option<f64>,
}

impl CoverageRecord {
    /// The record of a calibration on these results and truths.
    pub fn of(coverage: &Coverage, files: &[[&Path; 2]]) -> Self {
        let limits = |part: RegionPart| {
            let at = |level: f64| coverage.limit(part, level);
            LimitsRecord { p50: at(0.5), p90: at(0.9), p95: at(0.95), p99: at(0.99) }
        };
        let files = |index: usize| files.iter().map(|pair| pair[index].display().to_string()).collect();
        Self {
            method: "split_conformal".to_owned(),
            objects: coverage.objects(),
            results: files(0),
            squared_distance: RegionsRecord {
                body: limits(RegionPart::Body),
                center: limits(RegionPart::Center),
                extents: limits(RegionPart::Extents),
            },
            truths: files(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::parse_scene_file;
    use serde_json::{Value, json};

    fn file(objects: Value) -> SceneFile {
        let scene = json!({ "format": "quadlift.scene", "version": 1, "name": "a", "objects": objects });
        parse_scene_file("a.json".as_ref(), scene.to_string().as_bytes()).unwrap()
    }

    fn ellipsoid(x: f64) -> Value {
        json!({ "center": [x, 0, 0], "semi_axes": [3, 2, 1], "rotation": [1, 0, 0, 0] })
    }

    #[test]
    fn objects_are_paired_by_id_and_must_be_ok() {
        let matrix: Vec<Vec<f64>> = (0..9).map(|i| (0..9).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        let estimate = |id: &str, x: f64, status: &str| {
            let covariance = json!({ "coordinates": "center_vech_shape", "matrix": matrix });
            json!({ "id": id, "status": status, "ellipsoid": ellipsoid(x), "covariance": covariance })
        };
        let result = file(json!([estimate("a", 2.0, "ok"), estimate("b", 9.0, "diverged"), estimate("c", 5.0, "ok")]));
        let truth = file(json!([
            { "id": "b", "ellipsoid": ellipsoid(0.0) },
            { "id": "a", "ellipsoid": ellipsoid(0.0) },
        ]));
        let paths = [Path::new("r.json"), Path::new("t.json")];
        let found = coverage(&[[(paths[0], &result), (paths[1], &truth)]]).unwrap();
        assert_eq!(found.objects(), 1);
        assert_eq!(found.limit(RegionPart::Center, 0.5), Some(4.0));
        let record = serde_json::to_value(CoverageRecord::of(&found, &[paths])).unwrap();
        assert_eq!(record["squared_distance"]["center"]["0.5"], 4.0);
        assert_eq!(record["squared_distance"]["body"]["0.95"], Value::Null);
        let none = file(json!([{ "id": "z", "ellipsoid": ellipsoid(0.0) }]));
        let error = coverage(&[[(paths[0], &result), (paths[1], &none)]]).unwrap_err().to_string();
        assert!(error.contains("r.json") && error.contains("t.json"), "{error}");
    }
}
