//! What is odd in a valid scene and makes its result worthless: `info` lists it, `localize` warns of it.

use quadlift::scene::{Detection, Scene};

/// Boxes that reach farther out of the image than this are counted (pixels).
const OUTSIDE_TOLERANCE: f64 = 1.0;

/// Fewer boxes outside of the image than one of so many are single mistakes.
const FEW: usize = 10;

/// How a box lies about the border of its image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reach {
    /// In the image.
    Inside,
    /// A part of it lies outside.
    Beyond,
    /// All of it lies outside.
    Outside,
}

/// How the box of a detection lies; `None` without a box or a size of the image.
pub(crate) fn reaches(scene: &Scene, detection: &Detection) -> Option<Reach> {
    let b = detection.box_in_image.or(detection.bounding_box)?;
    let size = scene.frames[detection.frame_index as usize].image_size?;
    Some(if b.x1() <= 0.0 || b.y1() <= 0.0 || b.x0() >= size.x || b.y0() >= size.y {
        Reach::Outside
    } else if b.x0().min(b.y0()) < -OUTSIDE_TOLERANCE
        || b.x1() > size.x + OUTSIDE_TOLERANCE
        || b.y1() > size.y + OUTSIDE_TOLERANCE
    {
        Reach::Beyond
    } else {
        Reach::Inside
    })
}

/// The oddities of boxes that both commands name.
pub(crate) fn scene_oddities(scene: &Scene) -> Vec<String> {
    let mut oddities = Vec::new();
    let outside: Vec<&Detection> =
        scene.detections.iter().filter(|d| reaches(scene, d) == Some(Reach::Outside)).collect();
    if !outside.is_empty() {
        let boxes = if outside.len() == 1 { "1 box lies".to_owned() } else { format!("{} boxes lie", outside.len()) };
        let turned = outside.iter().filter(|d| fits_turned(scene, d)).count();
        let hint = match (outside.len() > 1 && outside.len() * FEW > scene.detections.len(), 2 * turned > outside.len())
        {
            (false, _) => "",
            (true, true) => "; they lie in images of the other orientation: are width and height swapped?",
            (true, false) => "; is the size of the cameras' images right?",
        };
        oddities.push(format!("{boxes} entirely outside the image{hint}"));
    }
    if are_fractions(scene) {
        oddities.push(
            "all boxes lie in the first pixel: are they fractions of the image (--assume box_scale=normalized)?"
                .to_owned(),
        );
    }
    oddities
}

/// That of cameras at one position, which also both name; what was localized has depths.
pub(crate) fn camera_oddity(scene: &Scene) -> Option<String> {
    one_point(scene).then(|| {
        let is_one_pose = scene.frames.iter().all(|frame| frame.projection == scene.frames[0].projection);
        let which = if is_one_pose { "all poses are the same" } else { "all cameras are at the same position" };
        format!("{which}: depths and sizes cannot be estimated")
    })
}

/// Whether all boxes lie within a pixel or two, as fractions of width and height do.
fn are_fractions(scene: &Scene) -> bool {
    let is_fraction = |d: &Detection| {
        let edges = d.box_in_image.or(d.bounding_box)?;
        scene.frames[d.frame_index as usize].image_size?;
        Some(edges.x0().min(edges.y0()) > -1.0 && edges.x1().max(edges.y1()) < 2.0)
    };
    let mut known = scene.detections.iter().filter_map(is_fraction).peekable();
    known.peek().is_some() && known.all(|is_fraction| is_fraction)
}

/// Whether the box of a detection lies in an image of the other orientation.
fn fits_turned(scene: &Scene, detection: &Detection) -> bool {
    let size = scene.frames[detection.frame_index as usize].image_size.unwrap_or_default();
    detection.box_in_image.or(detection.bounding_box).is_some_and(|b| {
        b.x0().min(b.y0()) >= -OUTSIDE_TOLERANCE
            && b.x1() <= size.y + OUTSIDE_TOLERANCE
            && b.y1() <= size.x + OUTSIDE_TOLERANCE
    })
}

/// Whether there are several frames, all with one camera center (to a millionth of the distance from the origin).
pub(crate) fn one_point(scene: &Scene) -> bool {
    let mut centers = scene.frames.iter().filter_map(|frame| frame.projection.center_in_world());
    let Some(first) = centers.next() else { return false };
    let tolerance = 1e-6 * first.coords.norm();
    scene.frames.len() > 1 && centers.all(|center| (center - first).norm() <= tolerance)
}
