//! Options that a map depends on, as they stand in a state: by the names of the command line.

use quadlift::association::IdUse;
use quadlift::online::OnlineOptions;
use quadlift::solve::{CategoryPriors, PoseNoise};
use serde::Deserialize;
use serde_json::{Map, Value, json};

/// Where the priors of a map come from.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum StoredPriors {
    /// `builtin`, or the path of a file.
    Name(String),
    /// The text of such a file.
    Text {
        /// TOML.
        text: String,
    },
}

/// The options that a map depends on. A state goes on with the same ([`super::read_state_file`]).
pub fn lasting_options(
    map: &OnlineOptions,
    priors: Option<&StoredPriors>,
    pose_noise: Option<PoseNoise>,
    source: Option<&str>,
) -> Map<String, Value> {
    let options = json!({
        "ids": id_use_name(map.ids),
        "min-views": map.min_views,
        "min-score": map.min_score,
        "pixel-sd": map.pixel_sd,
        "priors": priors.map(|priors| match priors {
            StoredPriors::Name(name) => json!(name),
            StoredPriors::Text { text } => json!({ "text": text }),
        }),
        "max-views": map.max_views,
        "max-objects": map.max_objects,
        "pose-noise": pose_noise.map(|noise| [noise.rotation_sd, noise.translation_sd]),
        "source": source,
    });
    match options {
        Value::Object(options) => options,
        _ => Map::new(),
    }
}

/// The options that [`lasting_options`] has written, without the priors themselves.
///
/// # Errors
/// Says in words which option is wrong.
pub fn options_of(
    record: &Map<String, Value>,
) -> Result<(OnlineOptions, Option<StoredPriors>, Option<PoseNoise>), String> {
    fn read<T: for<'a> Deserialize<'a>>(record: &Map<String, Value>, name: &str) -> Result<T, String> {
        let value = record.get(name).unwrap_or(&Value::Null);
        T::deserialize(value).map_err(|_| format!("the state is damaged: the option \"{name}\" is {value}"))
    }
    let ids: String = read(record, "ids")?;
    let ids = [IdUse::Trust, IdUse::Evidence, IdUse::Ignore].into_iter().find(|known| id_use_name(*known) == ids);
    let pose_noise: Option<[f64; 2]> = read(record, "pose-noise")?;
    let options = OnlineOptions {
        ids: ids.ok_or("the state is damaged: the option \"ids\" has an unknown value")?,
        min_views: read(record, "min-views")?,
        min_score: read(record, "min-score")?,
        pixel_sd: read(record, "pixel-sd")?,
        priors: CategoryPriors::default(),
        max_views: read(record, "max-views")?,
        max_objects: read(record, "max-objects")?,
        ..OnlineOptions::default()
    };
    let noise = |[rotation_sd, translation_sd]: [f64; 2]| PoseNoise { rotation_sd, translation_sd };
    Ok((options, read(record, "priors")?, pose_noise.map(noise)))
}

/// The name of a use of ids on the command line.
pub fn id_use_name(ids: IdUse) -> &'static str {
    match ids {
        IdUse::Trust => "trust",
        IdUse::Evidence => "evidence",
        IdUse::Ignore => "ignore",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_as_they_were_written() {
        let options = OnlineOptions { ids: IdUse::Trust, min_score: Some(0.1), max_views: 7, ..Default::default() };
        let noise = Some(PoseNoise { rotation_sd: 0.01, translation_sd: 0.2 });
        let text = StoredPriors::Text { text: "[cup]".to_owned() };
        for priors in [None, Some(StoredPriors::Name("builtin".to_owned())), Some(text)] {
            let record = lasting_options(&options, priors.as_ref(), noise, None);
            assert_eq!(options_of(&record), Ok((options.clone(), priors, noise)));
        }
    }

    #[test]
    fn a_wrong_option_is_named() {
        let mut record = lasting_options(&OnlineOptions::default(), None, None, None);
        record["max-views"] = json!("many");
        assert_eq!(options_of(&record).unwrap_err(), "the state is damaged: the option \"max-views\" is \"many\"");
    }
}
