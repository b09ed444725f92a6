//! Surfaces on which the objects of a scene stand, and their effect on the objects (docs/method.md, section 22).

use std::collections::BTreeMap;

use nalgebra::{Unit, Vector3};

use super::scene_fit::SceneFit;
use crate::parallel::map_indices;
use crate::solve::map::context::MapContext;
use crate::solve::map::object::fit::Fit;
use crate::solve::map::shared::ground::LowestPoint;
use crate::solve::map::shared::surfaces::{Support, Surfaces};
use crate::solve::supporting_surface::SupportingSurface;

/// The surfaces of a scene.
#[derive(Debug, Clone, Default)]
pub(crate) struct SceneSurfaces {
    surfaces: Surfaces,
    /// What each object stands on, by its index in the scene.
    of_object: BTreeMap<usize, Option<Support>>,
    described: Vec<SupportingSurface>,
}

impl SceneSurfaces {
    /// From lowest points, by the index of the object in the scene.
    fn find(up: &Unit<Vector3<f64>>, objects: &[(usize, LowestPoint)]) -> Self {
        let surfaces = Surfaces::find(up, &objects.iter().map(|(_, lowest)| lowest).collect::<Vec<_>>());
        let of_object: BTreeMap<usize, Option<Support>> =
            objects.iter().map(|(index, lowest)| (*index, surfaces.below(lowest, true))).collect();
        let described = surfaces.surfaces.iter().enumerate().filter_map(|(k, surface)| {
            let stands = |(index, _): &&(usize, LowestPoint)| of_object[index].is_some_and(|below| below.surface == k);
            let (objects, lowest): (Vec<usize>, Vec<LowestPoint>) = objects.iter().filter(stands).copied().unzip();
            let (point, normal, height_sd) = surface.describe(&lowest);
            (!objects.is_empty()).then_some(SupportingSurface { objects, point, normal, height_sd })
        });
        Self { described: described.collect(), of_object, surfaces }
    }

    /// Puts an object on what it probably stands on.
    pub(super) fn put_down(&self, fit: &mut Fit, up: &Unit<Vector3<f64>>) {
        if self.surfaces.surfaces.is_empty() || fit.is_on_ground() {
            return;
        }
        let support = match self.of_object.get(&fit.problem.views.object_index) {
            Some(known) => *known,
            None => fit.lowest_point(up).and_then(|lowest| self.surfaces.below(&lowest, false)),
        };
        if let Some(support) = support {
            fit.stand_on(&support);
        }
    }

    /// The surfaces, and which objects stand on them.
    pub(crate) fn report(&self) -> Vec<SupportingSurface> {
        self.described.clone()
    }
}

impl SceneFit {
    /// The same with objects on surfaces, if these are asked for.
    pub(crate) fn with_surfaces(mut self, context: &MapContext) -> Self {
        let asked = context.options.supporting_surfaces && !context.watch.is_cancelled();
        let Some(up) = context.up.filter(|_| asked) else { return self };
        let fits = self.fit_of_each();
        let lowest = map_indices(fits.len(), |k| {
            let fit = fits[k].filter(|fit| !fit.is_on_ground())?;
            Some((fit.problem.views.object_index, fit.lowest_point(&up)?))
        });
        let lowest: Vec<(usize, LowestPoint)> = lowest.into_iter().flatten().collect();
        let surfaces = SceneSurfaces::find(&up, &lowest);
        self = self.refitted(|fit| surfaces.put_down(fit, &up));
        self.surfaces = surfaces;
        self
    }
}
