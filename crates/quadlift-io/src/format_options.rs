//! The declaration of an option of a format, and what its texts stand for.

use std::path::PathBuf;

/// An option that readers or writers of formats take: its name, its value and its help, and how it is set by a text.
#[derive(Debug)]
pub struct FormatOption<O: 'static> {
    /// The name with underscores; the program writes dashes.
    pub name: &'static str,
    /// The placeholder of the value; empty for a flag.
    pub value: &'static str,
    /// A short text.
    pub help: &'static str,
    /// Sets the option; says what was expected. The text of a flag is empty.
    pub set: fn(&mut O, &str) -> Result<(), String>,
}

impl<O> FormatOption<O> {
    /// An option.
    pub(crate) const fn new(
        name: &'static str,
        value: &'static str,
        help: &'static str,
        set: fn(&mut O, &str) -> Result<(), String>,
    ) -> Self {
        Self { name, value, help, set }
    }
}

pub(crate) fn path(option: &mut Option<PathBuf>, text: &str) -> Result<(), String> {
    *option = Some(text.into());
    Ok(())
}

pub(crate) fn name(option: &mut Option<String>, text: &str) -> Result<(), String> {
    *option = Some(text.to_owned());
    Ok(())
}

pub(crate) fn whole<T: std::str::FromStr>(option: &mut Option<T>, text: &str) -> Result<(), String> {
    *option = Some(text.parse().map_err(|_| "expected a whole number that is not negative".to_owned())?);
    Ok(())
}

/// Reads a number of which something holds.
pub(crate) fn number(text: &str, is: fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|x: &f64| x.is_finite() && is(*x));
    number.ok_or_else(|| format!("expected {expected}"))
}

pub(crate) fn positive(option: &mut Option<f64>, text: &str) -> Result<(), String> {
    *option = Some(number(text, |x| x > 0.0, "a number above 0")?);
    Ok(())
}

pub(crate) fn one_of<'a>(text: &'a str, values: &[&str]) -> Result<&'a str, String> {
    if values.contains(&text) { Ok(text) } else { Err(format!("expected one of {}", values.join(", "))) }
}

pub(crate) fn list(text: &str) -> Vec<String> {
    text.split(',').map(str::to_owned).collect()
}
