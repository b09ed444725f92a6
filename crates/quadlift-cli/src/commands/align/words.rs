//! What was found, in words.

use quadlift::align::{AlignOptions, AlignStatus, Alignment, Ambiguity, MapTransform};
use quadlift_io::align::{Contradiction, MapObjects};
use quadlift_report::Labels;

use super::{Args, Map};
use crate::table::{Cell, MAX_ROWS, Table, rest, significant};
use crate::words::{count, with_unit};

/// What was assumed, a line.
pub(super) fn assumptions(args: &Args, [a, b]: [&Map; 2], options: &AlignOptions) -> String {
    let unit = |map: &Map| map.file.length_unit.clone();
    let scale = match (options.scale, unit(a), unit(b)) {
        (None, ..) if args.similarity => "the scale is estimated (--similarity)".to_owned(),
        (None, ..) => {
            "the scale is estimated: the files do not both have a known length_unit (--rigid holds it)".to_owned()
        }
        (Some(_), Some(x), Some(y)) if x == y => {
            format!("rigid: both files are in {x} (--similarity estimates the scale)")
        }
        (Some(scale), Some(x), Some(y)) => format!("scale {scale}: {y} in {x} (--similarity estimates it)"),
        (Some(_), ..) => "rigid: one scale (--rigid)".to_owned(),
    };
    let has_up = [a, b].map(|map| map.file.up.is_some());
    let up = match (&options.up, has_up) {
        (Some(_), _) => format!("`up` of both agrees to {} degrees (--no-up)", args.up_sd),
        (None, [true, true]) => "`up` is not used (--no-up)".to_owned(),
        (None, [false, false]) => "no `up` in the files".to_owned(),
        (None, [in_a, _]) => format!("`up` is not used: {} has none", if in_a { "B" } else { "A" }),
    };
    format!("assumed: {scale}; {up}\n")
}

/// Why the maps are not aligned.
pub(super) fn refused(
    found: &Alignment,
    [a, b]: [&MapObjects; 2],
    has_up: bool,
    contradicted: Option<&Contradiction>,
) -> String {
    let needed = if has_up { "two" } else { "three" };
    let why = match found.status {
        AlignStatus::TooFewObjects => format!(
            "too few objects: {} in A and {} in B, and fewer than {needed} of a map have a category that the other one has",
            count(a.objects.len(), "localized object"),
            b.objects.len()
        ),
        AlignStatus::Ambiguous(Ambiguity::Several) => {
            format!("ambiguous: {} explain the maps about as well", count(found.equally_good(), "different transform"))
        }
        AlignStatus::Ambiguous(Ambiguity::RotationOpen) => {
            "ambiguous: the objects that agree leave the rotation open, as those in one row do".to_owned()
        }
        AlignStatus::Ambiguous(Ambiguity::ScaleOpen) => {
            "ambiguous: the objects that agree leave the scale open".to_owned()
        }
        AlignStatus::Ambiguous(_) => {
            "ambiguous: too many objects are alike to compare all of them, and too few of those that were agree"
                .to_owned()
        }
        _ => "no transform explains the maps better than chance".to_owned(),
    };
    match contradicted {
        Some(contradicted) => format!("the maps were not aligned: {why}; {}", contradiction(contradicted, false)),
        None => format!("the maps were not aligned: {why}"),
    }
}

/// What the objects contradict; `is_aligned`: the maps are aligned all the same.
pub(super) fn contradiction(contradiction: &Contradiction, is_aligned: bool) -> String {
    match contradiction {
        Contradiction::Scale { found, sd, known } => {
            let kept = if is_aligned { "it was kept all the same, and " } else { "check the units, or " };
            format!(
                "by the objects a unit of B is {found:.4} units of A (sd {:.1} %), not {known}: {kept}--similarity takes the scale of the \
                 objects",
                100.0 * sd
            )
        }
        Contradiction::Mirrored => {
            "the mirror image of B fits clearly better: the axes of one of the maps are left-handed".to_owned()
        }
        Contradiction::Up => "without `up` of the files they are aligned (--no-up): check both `up`".to_owned(),
    }
}

/// The transforms that were considered, as a table; empty without any.
pub(super) fn candidates(found: &Alignment) -> String {
    if found.transforms.is_empty() {
        return String::new();
    }
    let mut table = Table::new(["objects", "scale", "rotation [deg]", "evidence"]);
    for transform in &found.transforms {
        table.push(vec![
            Cell::from(transform.matches.len().to_string()),
            Cell::from(format!("{:.4}", transform.a_from_b.scale)),
            Cell::from(format!("{:.1}", transform.a_from_b.angle().to_degrees())),
            Cell::from(format!("{:.1}", transform.evidence)),
        ]);
    }
    format!("\n{}", table.render())
}

/// The transform that was found, and its matches.
pub(super) fn aligned(
    title: &str,
    best: &MapTransform,
    [a, b]: [&Map; 2],
    options: &AlignOptions,
    about: &str,
) -> String {
    let unit = a.file.length_unit.as_deref();
    let [rotation_sd, position_sd, log_scale_sd] = best.sds();
    let to = &best.a_from_b;
    let [x, y, z]: [f64; 3] = to.translation.into();
    let scale = match options.scale {
        Some(_) => format!("{}", to.scale),
        None => format!("{:.5} (sd {:.5})", to.scale, to.scale * log_scale_sd),
    };
    let mut table = Table::new(["<object of A", "<object of B", "<category", &with_unit("distance", unit)]);
    let [labels_a, labels_b] = [a, b].map(|map| Labels::of_file(&map.file));
    for &(i, j) in best.matches.iter().take(MAX_ROWS) {
        let (p, q) = (&a.objects.objects[i], &b.objects.objects[j]);
        let distance = (p.ellipsoid.center - to.point(&q.ellipsoid.center)).norm();
        let category = p.category.as_deref().or(q.category.as_deref()).unwrap_or("-");
        table.push(vec![
            Cell::from(labels_a.of(&a.objects.ids[i])),
            Cell::from(labels_b.of(&b.objects.ids[j])),
            Cell::from(labels_a.category(&a.objects.ids[i], Some(category))),
            Cell::from(significant(distance, 2)),
        ]);
    }
    let rest = rest(best.matches.len(), "pair", "--json lists all");
    format!(
        "{title}: aligned by {} of {} and {}\n{about}\nscale        {scale}\nrotation     {:.3} deg (sd {:.3})\n{:<12} {x:.4} {y:.4} {z:.4} (sd {} at the \
         middle of the objects)\nevidence     {:.1}\n\n{}{rest}",
        count(best.matches.len(), "object"),
        a.objects.objects.len(),
        b.objects.objects.len(),
        to.angle().to_degrees(),
        rotation_sd.to_degrees(),
        with_unit("translation", unit),
        significant(position_sd, 2),
        best.evidence,
        table.render(),
    )
}
