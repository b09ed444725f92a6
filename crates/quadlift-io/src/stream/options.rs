//! Options that a map depends on, as they stand in a state: by their names.

use quadlift::online::OnlineOptions;
use quadlift::solve::PoseNoise;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::options::{MAP, Spelling, option_value, set_options, value_record};

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
    let mut options: Map<String, Value> =
        MAP.iter().map(|row| (row.name.to_owned(), value_record((row.get)(map)))).collect();
    let priors = priors.map(|priors| match priors {
        StoredPriors::Name(name) => json!(name),
        StoredPriors::Text { text } => json!({ "text": text }),
    });
    options.insert("priors".to_owned(), json!(priors));
    options.insert("pose_noise".to_owned(), json!(pose_noise.map(|noise| [noise.rotation_sd, noise.translation_sd])));
    options.insert("source".to_owned(), json!(source));
    options
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
    let value = |name| option_value(record.get(name).unwrap_or(&Value::Null)).unwrap_or_default();
    let given: Vec<_> = MAP.iter().map(|row| (row.name, value(row.name))).collect();
    let mut options = OnlineOptions::default();
    set_options(MAP, &given, &mut options, Spelling::Keyword)
        .map_err(|problem| format!("the state is damaged: {problem}"))?;
    let pose_noise: Option<[f64; 2]> = read(record, "pose_noise")?;
    let noise = |[rotation_sd, translation_sd]: [f64; 2]| PoseNoise { rotation_sd, translation_sd };
    Ok((options, read(record, "priors")?, pose_noise.map(noise)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::association::IdPolicy;

    #[test]
    fn options_are_read_as_they_were_written() {
        let options = OnlineOptions { ids: IdPolicy::Trust, min_score: Some(0.1), max_views: 7, ..Default::default() };
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
        record["max_views"] = json!("many");
        assert_eq!(
            options_of(&record).unwrap_err(),
            "the state is damaged: max_views is \"many\"; expected a whole number of at least 4"
        );
    }
}
