//! Options of a run.

use std::fmt::{Display, Formatter, Result as FmtResult};
use std::str::FromStr;

use crate::association::{AssociateOptions, IdPolicy};
use crate::localize::LocalizeOptions;
use crate::names::{UnknownName, unknown};
use crate::scene::Scene;

/// When detections are associated before their objects are localized.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum AssociateWhen {
    /// If detections of the source lack an object id; existing ids are trusted.
    #[default]
    Auto,
    /// Never: detections without an object id are skipped.
    Never,
    /// Always; ids are evidence.
    Always,
}

impl AssociateWhen {
    /// All values, in the order of their names.
    pub(crate) const ALL: [Self; 3] = [Self::Auto, Self::Never, Self::Always];
    /// The names of all values, as [`Display`] writes and [`FromStr`] reads them.
    pub const NAMES: [&str; 3] = ["auto", "never", "always"];

    /// The name of the value.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

impl Display for AssociateWhen {
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        f.pad(self.name())
    }
}

impl FromStr for AssociateWhen {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        let found = Self::ALL.into_iter().find(|value| value.name() == name);
        found.ok_or_else(|| unknown(name, "time to associate", &Self::NAMES))
    }
}

/// Options of [`crate::run()`].
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// How objects are localized, and of which source.
    pub localize: LocalizeOptions,
    /// When detections are associated first.
    pub associate: AssociateWhen,
    /// How far association trusts existing ids. Default: [`IdPolicy::Trust`], with [`AssociateWhen::Always`] [`IdPolicy::Evidence`].
    pub ids: Option<IdPolicy>,
    /// Apply the corrections that the check proposes.
    pub fix: bool,
}

impl RunOptions {
    /// How to use the ids of a scene if its detections are to be associated, otherwise `None`.
    pub fn ids_for(&self, scene: &Scene) -> Option<IdPolicy> {
        let default = match self.associate {
            AssociateWhen::Never => return None,
            AssociateWhen::Always => IdPolicy::Evidence,
            AssociateWhen::Auto => {
                // An ambiguous source is reported later.
                let source = scene.source_index(self.localize.source.as_deref()).unwrap_or_default();
                let mut used = scene.detections.iter().filter(|d| source.is_none() || d.source_index == source);
                if used.all(|d| d.object_index.is_some()) {
                    return None;
                }
                IdPolicy::Trust
            }
        };
        Some(self.ids.unwrap_or(default))
    }

    /// The options of the association that precedes the localization.
    pub(super) fn of_association(&self, ids: IdPolicy) -> AssociateOptions {
        AssociateOptions {
            source: self.localize.source.clone(),
            ids,
            priors: self.localize.method.posterior_options().map(|map| map.priors.clone()).unwrap_or_default(),
            ..Default::default()
        }
    }
}
