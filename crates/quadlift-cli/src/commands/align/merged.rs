//! The merged map: localized again where both files have detections, and written.

use std::path::Path;

use quadlift::LocalizeOptions;
use quadlift::align::MapTransform;
use quadlift::run::{AssociateWhen, RunOptions};
use quadlift_io::align::{ALIGNMENT, Merged, merge};
use quadlift_io::run::{FileInput, PriorSource};
use quadlift_io::scene_file::count_localized;
use quadlift_io::{SceneFile, write_scene_file};
use quadlift_report::Labels;
use serde_json::{Value, json};

use super::{Args, Map};
use crate::diagnosis::tell;
use crate::error::{InconsistentError, Outcome};
use crate::files::move_paths;
use crate::localization::{file_options, run_scene};
use crate::output::{Output, one_line};
use crate::words::count;

/// What was written.
pub(super) struct Written {
    pub text: String,
    pub document: Value,
    pub outcome: Outcome,
}

/// Merges the maps and writes the result.
pub(super) fn write(
    args: &Args,
    output: &Path,
    [a, b]: [&Map; 2],
    transform: &MapTransform,
    mut record: Value,
    out: &Output,
) -> anyhow::Result<Written> {
    // What is wrong in one of the files is told with its entry there.
    for (map, path) in [(a, &args.a), (b, &args.b)] {
        map.file.to_scene().map_err(|error| error.in_file(path))?;
    }
    let mut file_b = b.file.clone();
    let folder = |path: &Path| path.parent().map(Path::to_owned).unwrap_or_default();
    file_b.move_paths([&folder(&args.b), &folder(&args.a)])?;
    let merged = merge(&a.file, &file_b, [&a.objects, &b.objects], transform);
    let mut merged = merged.map_err(|error| error.in_file(&args.b))?;
    let mut text = String::new();
    let mut problems = Vec::new();
    if merged.has_detections {
        let (words, found) = localize_again(args, &mut merged, out)?;
        text.push_str(&words);
        problems = found;
    } else {
        text.push_str("the estimates of the files were kept: they do not both have detections of objects\n");
    }
    let twice = merged.at_one_place().map_err(|error| error.in_file(output))?;
    record["b"] = args.b.display().to_string().into();
    record["localized_together"] = merged.has_detections.into();
    record["renamed_frames"] = renamed(&merged.renamed_frames);
    record["renamed_objects"] = renamed(&merged.renamed_objects);
    record["at_one_place"] = json!(twice);
    let document = json!({
        "output": output.display().to_string(),
        "frames": merged.file.frames.len(),
        "objects": merged.file.objects.len(),
        "localized_together": merged.has_detections,
        "renamed_frames": record["renamed_frames"],
        "renamed_objects": record["renamed_objects"],
        "at_one_place": record["at_one_place"],
    });
    merged.file.extra.insert(ALIGNMENT.to_owned(), record);
    move_paths(&mut merged.file, &args.a, output)?;
    write_scene_file(output, &merged.file)?;
    let labels = Labels::of_file(&merged.file);
    for [p, q] in &twice {
        let [p, q] = [labels.of(p), labels.of(q)];
        out.warning(&one_line(&format!("{p} and {q} have one category and lie at one place, but are not merged")));
    }
    let renamed = [(merged.renamed_frames.len(), "frame"), (merged.renamed_objects.len(), "object")];
    let renamed: Vec<String> = renamed.iter().filter(|(n, _)| *n > 0).map(|(n, what)| count(*n, what)).collect();
    if !renamed.is_empty() {
        text.push_str(&format!("renamed in B, because their ids are taken in A: {}\n", renamed.join(" and ")));
    }
    text.push_str(&format!(
        "wrote {}: {}, {}\n",
        output.display(),
        count(merged.file.frames.len(), "frame"),
        count(merged.file.objects.len(), "object")
    ));
    out.errors(&problems);
    let outcome = if problems.is_empty() { Outcome::Fine } else { Outcome::SomethingFailed };
    Ok(Written { text, document, outcome })
}

fn renamed(names: &[(String, String)]) -> Value {
    names.iter().map(|(from, to)| json!({ "from": from, "to": to })).collect()
}

/// Localizes the objects from the detections of both maps, with the defaults of `quadlift localize`; what was found, and files that cannot be
/// read.
fn localize_again(args: &Args, merged: &mut Merged, out: &Output) -> anyhow::Result<(String, Vec<String>)> {
    let title = "the merged map";
    let localize = LocalizeOptions {
        source: args.source.clone(),
        allow_inconsistent: args.allow_inconsistent,
        ..Default::default()
    };
    let options = RunOptions { localize, associate: AssociateWhen::Never, ..Default::default() };
    let file = SceneFile { objects: Vec::new(), ..merged.file.clone() };
    let input = FileInput::from_file(file, &args.a, &[])?;
    let run = run_scene(title, input, &file_options(options, PriorSource::None)?, out)?;
    let check = &run.run.check;
    if !check.diagnosis.consistent && !args.allow_inconsistent {
        let diagnosis = run.diagnosis();
        let why = diagnosis.in_words().unwrap_or_default();
        let text = format!("{title} is inconsistent, though each map may be consistent: {why}");
        return Err(InconsistentError { text, diagnosis }.into());
    }
    tell(check, &run.input.context, args.allow_inconsistent, title, out);
    let mut result = run.result();
    result.detections = run.input.file.detections.clone();
    let estimates = &run.run.localization.estimates;
    let localized = count_localized(estimates);
    // Objects without detections (a map may have objects that its file shows in no frame) keep their estimates.
    let known: std::collections::BTreeSet<&str> = run.input.scene().object_ids.iter().map(String::as_str).collect();
    let kept: Vec<_> =
        merged.file.objects.iter().filter(|object| !known.contains(object.id.as_str())).cloned().collect();
    result.objects.extend(kept);
    merged.file = result;
    let of = count(estimates.len(), "object");
    Ok((format!("localized {localized} of {of} from the detections of both maps\n"), run.input.problems))
}
