//! `quadlift synth --cues`: outlines, oriented boxes, depths and 3D boxes of detectors of single images.

use clap::ValueEnum;
use quadlift::geometry::Body;
use quadlift::scene::{Detection, Scene, SceneError};
use quadlift::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, OrientedBoxNoise, ShapeOptions, SyntheticScene, simulate_cues, simulate_shapes,
};
use quadlift_io::SceneFile;

use crate::args;

/// Standard deviation of the radius of outlines, unless the user says otherwise: as good as the edges of boxes.
const OUTLINE_NOISE: f64 = 0.03;

/// Outlines, oriented boxes, depths and 3D boxes.
#[derive(clap::Args)]
#[command(next_help_heading = "Outlines, depths and 3D boxes")]
pub(super) struct CueArgs {
    /// What each detection carries besides its box: any of outline, oriented_box, depth, box3d
    #[arg(long, value_name = "CUE,...", value_delimiter = ',', value_enum)]
    cues: Vec<Cue>,

    /// Error of what --cues names and its amount, such as depth:0.05 (see below)
    #[arg(long, value_name = "KIND:AMOUNT", value_parser = cue_noise, requires = "cues")]
    cue_noise: Vec<CueNoise>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
enum Cue {
    Outline,
    OrientedBox,
    Depth,
    #[value(name = "box3d")]
    Box3d,
}

/// An error, and its amount.
#[derive(Debug, Clone, Copy, PartialEq)]
struct CueNoise {
    kind: Kind,
    amount: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Outline,
    Angle,
    Sides,
    Depth,
    DepthScale,
    DepthShift,
    DepthOutliers,
    Distance,
    Across,
    Size,
    SizeScale,
    Yaw,
    Flips,
    BoxOutliers,
}

/// The kinds by the names of the command line, with the cue that has them.
const KINDS: [(&str, Kind, Cue); 14] = [
    ("outline", Kind::Outline, Cue::Outline),
    ("angle", Kind::Angle, Cue::OrientedBox),
    ("sides", Kind::Sides, Cue::OrientedBox),
    ("depth", Kind::Depth, Cue::Depth),
    ("depth-scale", Kind::DepthScale, Cue::Depth),
    ("depth-shift", Kind::DepthShift, Cue::Depth),
    ("depth-outliers", Kind::DepthOutliers, Cue::Depth),
    ("distance", Kind::Distance, Cue::Box3d),
    ("across", Kind::Across, Cue::Box3d),
    ("size", Kind::Size, Cue::Box3d),
    ("size-scale", Kind::SizeScale, Cue::Box3d),
    ("yaw", Kind::Yaw, Cue::Box3d),
    ("flips", Kind::Flips, Cue::Box3d),
    ("box3d-outliers", Kind::BoxOutliers, Cue::Box3d),
];

fn cue_noise(text: &str) -> Result<CueNoise, String> {
    let names = || KINDS.map(|(name, ..)| name).join(", ");
    let (name, amount) = text.split_once(':').ok_or_else(|| format!("expected KIND:AMOUNT with {}", names()))?;
    let amount = args::finite(amount)?;
    let Some((_, kind, _)) = KINDS.iter().find(|(known, ..)| *known == name) else {
        return Err(format!("unknown error \"{name}\"; expected {}", names()));
    };
    let (range, expected) = match kind {
        Kind::DepthScale | Kind::SizeScale => (f64::MIN_POSITIVE..=f64::MAX, "a positive factor"),
        Kind::DepthShift => (f64::MIN..=f64::MAX, "a number"),
        Kind::DepthOutliers | Kind::Flips | Kind::BoxOutliers => (0.0..=1.0, "a share from 0 to 1"),
        _ => (0.0..=f64::MAX, "a number of at least 0"),
    };
    if !range.contains(&amount) {
        return Err(format!("found {amount}; expected {expected}"));
    }
    Ok(CueNoise { kind: *kind, amount })
}

impl CueArgs {
    /// Whether detections carry more than boxes.
    pub(super) fn is_used(&self) -> bool {
        !self.cues.is_empty()
    }

    /// The errors of depths and 3D boxes, and of outlines and oriented boxes; or what does not fit together.
    pub(super) fn options(&self) -> Result<(CueOptions, ShapeOptions), String> {
        let (mut depth, mut box3d) = (DepthNoise::default(), Box3dNoise::default());
        let (mut outline, mut turned) = (OUTLINE_NOISE, OrientedBoxNoise::default());
        for &CueNoise { kind, amount } in &self.cue_noise {
            for (name, known, cue) in KINDS {
                if known == kind && !self.cues.contains(&cue) {
                    let cue = cue.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
                    return Err(format!("--cue-noise {name} is an error of {cue}, which --cues does not name"));
                }
            }
            match kind {
                Kind::Outline => outline = amount,
                Kind::Angle => turned.angle = amount.to_radians(),
                Kind::Sides => turned.sides = amount,
                Kind::Depth => depth.noise = amount,
                Kind::DepthScale => depth.scale = amount,
                Kind::DepthShift => depth.shift = amount,
                Kind::DepthOutliers => depth.outliers = amount,
                Kind::Distance => box3d.distance = amount,
                Kind::Across => box3d.across = amount,
                Kind::Size => box3d.size = amount,
                Kind::SizeScale => box3d.size_bias = amount,
                Kind::Yaw => box3d.yaw = amount.to_radians(),
                Kind::Flips => box3d.flips = amount,
                Kind::BoxOutliers => box3d.outliers = amount,
            }
        }
        let has = |cue| self.cues.contains(&cue);
        let cues = CueOptions { depth: has(Cue::Depth).then_some(depth), box3d: has(Cue::Box3d).then_some(box3d) };
        let (outline, oriented_box) = (has(Cue::Outline).then_some(outline), has(Cue::OrientedBox).then_some(turned));
        Ok((cues, ShapeOptions { outline, oriented_box }))
    }
}

/// The true body of each detection; false and wrong boxes have none.
fn bodies(synthetic: &SyntheticScene) -> impl Fn(usize, &Detection) -> Option<Body> {
    |index, _| {
        let object = synthetic.true_objects.get(index).copied().flatten()?;
        let is_wrong = synthetic.outliers.get(index).is_some_and(|wrong| *wrong);
        (!is_wrong).then(|| synthetic.truth[object].1)
    }
}

/// Gives the detections of true objects in a scene file outlines and oriented boxes.
pub(super) fn add_shapes(file: &mut SceneFile, synthetic: &SyntheticScene, options: &ShapeOptions, seed: u64) {
    let shapes = simulate_shapes(&synthetic.scene, bodies(synthetic), options, seed);
    for (record, shape) in file.detections.iter_mut().zip(shapes) {
        record.outline = shape.outline.map(Vec::into_boxed_slice);
        record.oriented_box = shape.oriented_box.map(|turned| Box::new(turned.into()));
    }
}

/// The scene whose detections of true objects carry depths and 3D boxes; false and wrong boxes have none.
pub(super) fn with_cues(synthetic: &SyntheticScene, options: &CueOptions, seed: u64) -> Result<Scene, SceneError> {
    simulate_cues(&synthetic.scene, bodies(synthetic), options, seed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_read_and_go_with_their_cue() {
        assert_eq!(cue_noise("depth-scale:1.2"), Ok(CueNoise { kind: Kind::DepthScale, amount: 1.2 }));
        assert_eq!(cue_noise("depth-shift:-1"), Ok(CueNoise { kind: Kind::DepthShift, amount: -1.0 }));
        for wrong in ["depth", "depth:x", "fog:1", "depth:-1", "depth-scale:0", "flips:1.5"] {
            assert!(cue_noise(wrong).is_err(), "{wrong}");
        }
        let noise = |texts: &[&str]| texts.iter().map(|text| cue_noise(text).unwrap()).collect();
        let both = CueArgs { cues: vec![Cue::Depth, Cue::Box3d], cue_noise: noise(&["depth:0.2", "yaw:90"]) };
        let (options, shapes) = both.options().unwrap();
        assert_eq!(shapes, ShapeOptions::default());
        assert_eq!(options.depth, Some(DepthNoise { noise: 0.2, ..Default::default() }));
        assert_eq!(options.box3d.unwrap().yaw, std::f64::consts::FRAC_PI_2);
        let depth = CueArgs { cues: vec![Cue::Depth], cue_noise: Vec::new() };
        assert_eq!(depth.options().unwrap().0.box3d, None);
        let cues = vec![Cue::Outline, Cue::OrientedBox];
        let shapes = CueArgs { cues, cue_noise: noise(&["outline:0.1", "angle:90"]) }.options().unwrap().1;
        let turned = OrientedBoxNoise { angle: std::f64::consts::FRAC_PI_2, ..Default::default() };
        assert_eq!(shapes, ShapeOptions { outline: Some(0.1), oriented_box: Some(turned) });
        let other = CueArgs { cues: vec![Cue::Depth], cue_noise: noise(&["flips:0.5"]) };
        assert!(other.options().unwrap_err().contains("flips is an error of box3d"));
    }
}
