//! Values of options ([`super::Value`]) in JSON and in files.

use quadlift::run::RunOptions;
use serde_json::{Value, json};

use super::{Spelling, Value as OptionValue};

/// The value of an option in JSON.
pub(crate) fn value_record(value: OptionValue) -> Value {
    match value {
        OptionValue::Unset => Value::Null,
        OptionValue::Flag(flag) => flag.into(),
        OptionValue::Number(x) => x.into(),
        OptionValue::Whole(n) => n.into(),
        OptionValue::Text(text) => text.into(),
        OptionValue::Numbers(numbers) => numbers.into(),
        OptionValue::Levels(levels) => levels.into_iter().map(|(name, x)| (name, json!(x))).collect(),
    }
}

/// The value of an option from JSON; `None` if no option has such a value.
pub(crate) fn option_value(json: &Value) -> Option<OptionValue> {
    Some(match json {
        Value::Null => OptionValue::Unset,
        Value::Bool(flag) => (*flag).into(),
        Value::Number(number) => match number.as_u64() {
            Some(n) => OptionValue::Whole(n),
            None => number.as_f64()?.into(),
        },
        Value::String(text) => text.as_str().into(),
        Value::Array(numbers) => OptionValue::Numbers(numbers.iter().map(Value::as_f64).collect::<Option<_>>()?),
        Value::Object(levels) => {
            let level = |(name, x): (&String, &Value)| Some((name.clone(), x.as_f64()?));
            OptionValue::Levels(levels.iter().map(level).collect::<Option<_>>()?)
        }
    })
}

/// Refuses an option that is given beside those of [`super::RUN`] and needs the method `posterior`.
///
/// # Errors
/// A text that names the option.
pub fn check_needs_posterior(run: &RunOptions, name: &str, spelling: Spelling) -> Result<(), String> {
    match run.localize.method.posterior_options() {
        Some(_) => Ok(()),
        None => Err(format!(
            "{} is an option of {} only",
            spelling.option(name),
            spelling.with_value("method", "posterior")
        )),
    }
}
