//! Counts of skipped detections, by reason.

/// Numbers of detections skipped in a localization or an association, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct SkippedDetections {
    /// They name no object (localization; see [`crate::associate()`]).
    pub without_object: usize,
    /// Their occlusion or truncation level is too high.
    pub occluded_or_truncated: usize,
    /// In a part of the image where the lens cannot be undistorted, see [`crate::geometry::Camera::undistort_point`].
    pub beyond_lens: usize,
    /// Without the selected measurement, see [`crate::LocalizeOptions::measurements`].
    pub without_measurement: usize,
    /// They are of another source (association).
    pub other_source: usize,
    /// Their score is too low (association).
    pub low_score: usize,
    /// They overlap a better one of their frame and category (association).
    pub duplicate: usize,
}
