//! Options of a run.

use crate::association::{AssociateOptions, IdUse};
use crate::localize::LocalizeOptions;
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

/// Options of [`crate::run()`].
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// How objects are localized, and of which source.
    pub localize: LocalizeOptions,
    /// When detections are associated first.
    pub associate: AssociateWhen,
    /// How far association trusts existing ids. Default: [`IdUse::Trust`], with [`AssociateWhen::Always`] [`IdUse::Evidence`].
    pub ids: Option<IdUse>,
    /// Apply the corrections that the check proposes.
    pub fix: bool,
}

impl RunOptions {
    /// How to use the ids of a scene if its detections are to be associated, otherwise `None`.
    pub fn ids_for(&self, scene: &Scene) -> Option<IdUse> {
        let default = match self.associate {
            AssociateWhen::Never => return None,
            AssociateWhen::Always => IdUse::Evidence,
            AssociateWhen::Auto => {
                // An ambiguous source is reported later.
                let source = scene.source_index(self.localize.source.as_deref()).unwrap_or_default();
                let mut used = scene.detections.iter().filter(|d| source.is_none() || d.source_index == source);
                if used.all(|d| d.object_index.is_some()) {
                    return None;
                }
                IdUse::Trust
            }
        };
        Some(self.ids.unwrap_or(default))
    }

    /// The options of the association that precedes the localization.
    pub(super) fn of_association(&self, ids: IdUse) -> AssociateOptions {
        AssociateOptions {
            source: self.localize.source.clone(),
            ids,
            priors: self.localize.method.map_options().map(|map| map.priors.clone()).unwrap_or_default(),
            ..Default::default()
        }
    }
}
