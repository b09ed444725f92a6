//! Sizes of categories, learned from the objects of the scene, and their effect on the objects (docs/method.md, section 21).

use std::collections::BTreeMap;

use crate::geometry::BodyKind;
use crate::solve::learned_size::LearnedCategorySize;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::object::fit::Fit;
use crate::solve::posterior::shared::size_model::{LearnedSizes, SizeDistribution, SizeInformation};
use crate::sorting::StableSort;

/// The sizes of the categories of a scene; ellipsoids and cuboids of one category have different extents, so that each kind of
/// body has its own.
#[derive(Debug, Clone, Default)]
pub(crate) struct SceneSizes {
    groups: Vec<Group>,
    /// What an object of these learns from the others, by its index in the scene.
    of_object: BTreeMap<usize, Option<SizeDistribution>>,
}

/// The objects of one category and kind of body.
#[derive(Debug, Clone)]
struct Group {
    category: usize,
    kind: BodyKind,
    objects: usize,
    sizes: LearnedSizes,
}

impl SceneSizes {
    /// From fitted objects: index in the scene, fit, what its measurements tell about its size.
    pub(super) fn learn(objects: &[(usize, &Fit, SizeInformation)], context: &PosteriorContext) -> Self {
        let mut found = Self::default();
        let mut keys: Vec<(usize, BodyKind)> = Vec::new();
        for (_, fit, _) in objects {
            let Some(key) = group_of(fit) else { continue };
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        keys.stable_sort_by_key(|(category, _)| *category);
        for key in keys {
            let members: Vec<_> = objects.iter().filter(|(_, fit, _)| group_of(fit) == Some(key)).collect();
            // Where all stand their vertical axes are their heights.
            let up = context.up.filter(|_| members.iter().all(|(_, fit, _)| fit.is_upright()));
            let ordered =
                |(_, fit, told): &&(usize, &Fit, SizeInformation)| told.ordered(fit.order_of_axes(up.as_ref()));
            let told: Vec<SizeInformation> = members.iter().map(ordered).collect();
            let sizes = LearnedSizes::of(&told, up.is_some(), context.options.shape_sd);
            found.of_object.extend(members.iter().zip(&sizes.of_each).map(|((index, ..), size)| (*index, *size)));
            found.groups.push(Group { category: key.0, kind: key.1, objects: members.len(), sizes });
        }
        found
    }

    /// The size that an object is given: from the others.
    pub(crate) fn of(&self, fit: &Fit) -> Option<&SizeDistribution> {
        let (category, kind) = group_of(fit)?;
        if let Some(size) = self.of_object.get(&fit.problem.views.object_index) {
            return size.as_ref();
        }
        let group = self.groups.iter().find(|group| group.category == category && group.kind == kind);
        group.and_then(|group| group.sizes.of_all.as_ref())
    }

    /// Whether no object learns anything.
    pub(super) fn are_none(&self) -> bool {
        self.of_object.values().all(Option::is_none)
    }

    /// What was learned, by category and kind of body.
    pub(crate) fn report(&self) -> Vec<LearnedCategorySize> {
        self.groups.iter().map(|group| group.sizes.report(group.category, group.kind, group.objects)).collect()
    }
}

/// The objects with which this one is compared; `None` without a category, and where the size of the category is given.
fn group_of(fit: &Fit) -> Option<(usize, BodyKind)> {
    let category = fit.problem.views.category_index.filter(|_| fit.problem.prior.log_size.is_none())?;
    Some((category, fit.problem.kind))
}
