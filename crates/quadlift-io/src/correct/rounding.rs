//! Usual values near estimated ones: widths of images, units of length.

/// The units that `pose_unit` names, in meters.
pub(super) const UNITS: [(&str, f64); 6] =
    [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("km", 1e3), ("ft", 0.3048), ("in", 0.0254)];

/// A length estimated from sizes is that of a unit if it differs by less than this factor, because object sizes vary.
const SAME_UNIT: f64 = 1.6;

/// The length of the unit closest to a length in meters that was estimated from sizes; otherwise the length with two
/// digits (the scale of a map without a unit).
pub(super) fn nearest_unit(meters: f64) -> f64 {
    let distance = |unit: f64| (meters / unit).ln().abs();
    let near = UNITS.iter().map(|(_, unit)| *unit).filter(|unit| distance(*unit) < SAME_UNIT.ln());
    let digits = 10_f64.powf(1.0 - meters.log10().floor());
    near.min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or((meters * digits).round() / digits)
}

/// Widths of images are multiples of this as a rule: networks and video codecs ask for it.
const WIDTH_STEP: f64 = 16.0;

/// Share by which a width that the consistency check has found may be wrong.
const WIDTH_ERROR: f64 = 0.005;

/// The width, in pixels, that is meant by one that was found.
pub(crate) fn usual_width(found: f64) -> f64 {
    let usual = (found / WIDTH_STEP).round() * WIDTH_STEP;
    let is_near = (usual / found - 1.0).abs() < WIDTH_ERROR;
    if is_near { usual } else { found.round() }.max(1.0)
}
