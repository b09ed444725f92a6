//! Names of choices on the command line and in files: one table for every program that reads or writes them.

use std::fmt::{Display, Formatter, Result as FmtResult};
use std::str::FromStr;

use crate::association::IdPolicy;
use crate::geometry::BodyKind;
use crate::localize::MeasurementKind;
use crate::solve::{Method, PoseMotion, PosteriorOptions, RegOptions};

/// A name that stands for none of the choices.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{found:?} is not a {what}; expected one of {}", .expected.join(", "))]
pub struct UnknownName {
    /// What was read.
    pub found: String,
    /// What it should be: "method", "kind of body", "kind of measurement".
    pub what: &'static str,
    /// The names that exist.
    pub expected: &'static [&'static str],
}

pub(crate) fn unknown(found: &str, what: &'static str, expected: &'static [&'static str]) -> UnknownName {
    UnknownName { found: found.to_owned(), what, expected }
}

impl Method {
    /// The names of all methods, as [`Display`] writes and [`FromStr`] reads them.
    pub const NAMES: [&str; 5] = ["posterior", "planes", "lfd", "pfd", "reg"];

    /// The name of the method.
    pub fn name(&self) -> &'static str {
        Self::NAMES[match self {
            Self::Posterior(_) => 0,
            Self::Planes => 1,
            Self::Lfd => 2,
            Self::Pfd => 3,
            Self::Reg(_) => 4,
        }]
    }
}

impl Display for Method {
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        f.pad(self.name())
    }
}

impl FromStr for Method {
    type Err = UnknownName;

    /// The method of this name, with its default options.
    fn from_str(name: &str) -> Result<Self, UnknownName> {
        match name {
            "posterior" => Ok(Self::Posterior(PosteriorOptions::default())),
            "planes" => Ok(Self::Planes),
            "lfd" => Ok(Self::Lfd),
            "pfd" => Ok(Self::Pfd),
            "reg" => Ok(Self::Reg(RegOptions::default())),
            _ => Err(unknown(name, "method", &Self::NAMES)),
        }
    }
}

impl MeasurementKind {
    /// All kinds, in the order of their names.
    pub(crate) const ALL: [Self; 5] = [Self::Auto, Self::Box, Self::Ellipse, Self::BoxAndEllipse, Self::Mask];

    /// The names of all kinds, as [`Display`] writes and [`FromStr`] reads them.
    pub const NAMES: [&str; 5] = ["auto", "box", "ellipse", "box+ellipse", "mask"];

    /// The name of the kind.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

impl Display for MeasurementKind {
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        f.pad(self.name())
    }
}

impl FromStr for MeasurementKind {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        let found = Self::ALL.into_iter().find(|kind| kind.name() == name);
        found.ok_or_else(|| unknown(name, "kind of measurement", &Self::NAMES))
    }
}

impl PoseMotion {
    /// All motions, in the order of their names.
    pub(crate) const ALL: [Self; 3] = [Self::Auto, Self::Independent, Self::Slow];

    /// The names of all motions, as [`Display`] writes and [`FromStr`] reads them.
    pub const NAMES: [&str; 3] = ["auto", "independent", "slow"];

    /// The name of the motion.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

impl Display for PoseMotion {
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        f.pad(self.name())
    }
}

impl FromStr for PoseMotion {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        let found = Self::ALL.into_iter().find(|motion| motion.name() == name);
        found.ok_or_else(|| unknown(name, "motion of pose errors", &Self::NAMES))
    }
}

impl IdPolicy {
    /// All values, in the order of their names.
    pub(crate) const ALL: [Self; 3] = [Self::Trust, Self::Evidence, Self::Ignore];
    /// The names of all values, as [`Display`] writes and [`FromStr`] reads them.
    pub const NAMES: [&str; 3] = ["trust", "evidence", "ignore"];

    /// The name of the value.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

impl Display for IdPolicy {
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        f.pad(self.name())
    }
}

impl FromStr for IdPolicy {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        let found = Self::ALL.into_iter().find(|value| value.name() == name);
        found.ok_or_else(|| unknown(name, "use of ids", &Self::NAMES))
    }
}

impl Display for BodyKind {
    /// `ellipsoid`, `cuboid`, `cylinder`, `superellipsoid:Q` with the exponent of the support function, or `rounded:R` with the roundness.
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        match self.parameter() {
            None => f.pad(self.name()),
            Some(parameter) => write!(f, "{}:{}", self.name(), (1000.0 * parameter).round() / 1000.0),
        }
    }
}

impl FromStr for BodyKind {
    type Err = UnknownName;

    fn from_str(text: &str) -> Result<Self, UnknownName> {
        let (name, given) = text.split_once(':').map_or((text, None), |(name, given)| (name, Some(given)));
        let parameter = given.map(|given| given.parse().unwrap_or(f64::NAN));
        let is_valid = |kind: &Self| kind.parameter() == parameter && (1.0..=2.0).contains(&kind.exponent());
        let kind = Self::named(name, parameter.unwrap_or_default()).filter(is_valid);
        kind.ok_or_else(|| unknown(text, "kind of body", &Self::NAMES))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for name in Method::NAMES {
            assert_eq!(name.parse::<Method>().unwrap().to_string(), name);
        }
        for (kind, name) in MeasurementKind::ALL.into_iter().zip(MeasurementKind::NAMES) {
            assert_eq!((name.parse(), kind.to_string()), (Ok(kind), name.to_owned()));
        }
        for kind in BodyKind::ALL {
            assert_eq!(kind.to_string().parse(), Ok(kind));
        }
    }

    #[test]
    fn other_names_are_refused_with_what_there_is() {
        let error = "posteror".parse::<Method>().unwrap_err();
        assert_eq!(error.expected, Method::NAMES);
        assert_eq!(error.to_string(), "\"posteror\" is not a method; expected one of posterior, planes, lfd, pfd, reg");
        for wrong in ["sphere", "superellipsoid", "superellipsoid:3", "superellipsoid:NaN", ""] {
            assert!(wrong.parse::<BodyKind>().unwrap_err().to_string().contains("from 1 (cuboid) to 2"), "{wrong}");
        }
        assert!("boxes".parse::<MeasurementKind>().unwrap_err().to_string().contains("box+ellipse"));
    }
}
