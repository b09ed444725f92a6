//! Intrinsics of cameras, corrected; also those in the projections of frames.

use nalgebra::Vector2;
use quadlift::diagnosis::{CameraParts, Correction};
use quadlift::geometry::{CameraModel, Intrinsics, Projection};

use super::poses::{matrix, rows};
use crate::error::EntryError;
use crate::scene_file::{CameraRecord, SceneFile};

/// Corrects the intrinsics of all cameras and projections; returns their number.
pub(super) fn correct(file: &mut SceneFile, correction: &Correction) -> Result<usize, EntryError> {
    let mut changed = 0;
    let failed = |entry: String| {
        EntryError::new(
            entry,
            "the intrinsics cannot be corrected: expected a \"width\" and a \"height\" of the images",
        )
    };
    for (index, record) in file.cameras.iter_mut().enumerate() {
        // `to_scene` reports invalid cameras.
        let Some((model, intrinsics)) = intrinsics_of(record) else { continue };
        let corrected = correction.intrinsics(&intrinsics, size(record.width, record.height));
        set_intrinsics(record, model, &corrected.ok_or_else(|| failed(format!("cameras[{index}]")))?);
        changed += 1;
    }
    for (index, frame) in file.frames.iter_mut().enumerate() {
        let Some(given) = &mut frame.projection else { continue };
        let parts = Projection::from_matrix(matrix(given)).ok().as_ref().and_then(CameraParts::from_projection);
        let Some(parts) = parts else { continue };
        let corrected = correction.intrinsics(&parts.intrinsics, size(frame.width, frame.height));
        let intrinsics = corrected.ok_or_else(|| failed(format!("frames[{index}]")))?;
        if let Some(projection) = (CameraParts { intrinsics, ..parts }).projection() {
            *given = rows(projection.matrix());
            changed += 1;
        }
    }
    Ok(changed)
}

/// Gives all cameras a lens with one radial coefficient (`k` of COLMAP's `SIMPLE_RADIAL`); returns their number.
pub(super) fn add_lens(file: &mut SceneFile, coefficient: f64) -> Result<usize, EntryError> {
    if let Some(index) = file.frames.iter().position(|frame| frame.projection.is_some()) {
        return Err(EntryError::new(format!("frames[{index}]"), "a frame with a projection cannot have a lens model"));
    }
    for (index, record) in file.cameras.iter_mut().enumerate() {
        let Some((model, k)) = intrinsics_of(record) else { continue };
        (record.model, record.params) = match model {
            CameraModel::SimplePinhole => ("SIMPLE_RADIAL".to_owned(), vec![k.fx, k.cx, k.cy, coefficient]),
            CameraModel::Pinhole => ("OPENCV".to_owned(), vec![k.fx, k.fy, k.cx, k.cy, coefficient, 0.0, 0.0, 0.0]),
            _ => {
                let problem = format!("the camera already has a lens model ({})", record.model);
                return Err(EntryError::new(format!("cameras[{index}]"), problem));
            }
        };
    }
    Ok(file.cameras.len())
}

/// Width and height, where both are known.
pub(super) fn size(width: Option<f64>, height: Option<f64>) -> Option<Vector2<f64>> {
    width.zip(height).map(|(width, height)| Vector2::new(width, height))
}

/// The model of a camera with its focal lengths and principal point.
fn intrinsics_of(record: &CameraRecord) -> Option<(CameraModel, Intrinsics)> {
    let model = CameraModel::from_name(&record.model)?;
    let at = |name: &str| record.params.get(model.parameter_names().iter().position(|known| *known == name)?).copied();
    let (fx, fy) = (at("f").or_else(|| at("fx"))?, at("f").or_else(|| at("fy"))?);
    Some((model, Intrinsics::new(fx, fy, at("cx")?, at("cy")?).ok()?))
}

/// Writes focal lengths and principal point into a camera. A model with a single focal length is replaced by one with
/// two if they differ.
fn set_intrinsics(record: &mut CameraRecord, model: CameraModel, k: &Intrinsics) {
    let lens_at = if model.parameter_names().first() == Some(&"f") { 3 } else { 4 };
    let lens = record.params.get(lens_at..).unwrap_or_default().to_vec();
    if lens_at == 4 || (k.fx - k.fy).abs() <= 1e-9 * k.fx {
        let focal = if lens_at == 3 { vec![k.fx] } else { vec![k.fx, k.fy] };
        record.params = [focal, vec![k.cx, k.cy], lens].concat();
        return;
    }
    let (name, coefficients) = match model {
        CameraModel::SimpleRadial | CameraModel::Radial => ("OPENCV", 4),
        CameraModel::SimpleRadialFisheye | CameraModel::RadialFisheye => ("OPENCV_FISHEYE", 4),
        CameraModel::SimpleDivision => ("DIVISION", 1),
        CameraModel::SimpleFisheye => ("FISHEYE", 0),
        _ => ("PINHOLE", 0),
    };
    record.model = name.to_owned();
    record.params = vec![k.fx, k.fy, k.cx, k.cy];
    // Radial coefficients come first in all of these models; the others are zero.
    record.params.extend(lens.into_iter().chain(std::iter::repeat(0.0)).take(coefficients));
}
