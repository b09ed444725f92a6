//! Surfaces that are found from the objects standing on them.

use quadlift::geometry::ConvexBody;
use quadlift::metrics::iou3d_bodies;
use quadlift::nalgebra::Vector3;
use quadlift::scene::Scene;
use quadlift::solve::{BodyKind, MapOptions};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, generate};
use quadlift::{Localization, localize};

/// Twelve objects on the plane z = 0.
fn table(views: usize, body: BodyKind) -> SyntheticScene {
    generate(&SyntheticOptions {
        seed: 5,
        objects: 12,
        views,
        body,
        standing: true,
        cube_side: 20.0,
        distance: 60.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.1)],
        ..Default::default()
    })
    .unwrap()
}

fn options(supporting_surfaces: bool, body: BodyKind) -> MapOptions {
    MapOptions { supporting_surfaces, body: Some(body), ..Default::default() }
}

fn localized(scene: &Scene, options: MapOptions) -> Localization {
    localize(scene, &options.into()).unwrap()
}

fn mean_iou(made: &SyntheticScene, found: &Localization) -> f64 {
    let iou =
        |e: &quadlift::solve::Estimate| e.body.map_or(0.0, |body| iou3d_bodies(&body, &made.truth[e.object_index].1));
    found.estimates.iter().map(iou).sum::<f64>() / found.estimates.len() as f64
}

#[test]
fn the_table_is_found_and_its_objects_are_not_worse() {
    for body in [BodyKind::Ellipsoid, BodyKind::Cuboid] {
        let made = table(2, body);
        let without = localized(&made.scene, options(false, body));
        let with = localized(&made.scene, options(true, body));
        assert!(without.supporting_surfaces.is_empty());
        let [surface] = &with.supporting_surfaces[..] else { panic!("{:?}", with.supporting_surfaces) };
        assert!(surface.objects.len() >= 10, "{surface:?}");
        assert!(surface.point.z.abs() < 4.0 * surface.height_sd && surface.height_sd < 0.5, "{surface:?}");
        assert!(surface.normal.z > 0.995, "{surface:?}");
        assert!(mean_iou(&made, &with) > mean_iou(&made, &without) - 0.001, "{body:?}");
        // The heights of the lowest points of the bodies, which are zero.
        let spread = |found: &Localization| {
            let lowest = |e: &quadlift::solve::Estimate| e.body.map(|b| b.center().z - b.support(&Vector3::z()));
            found.estimates.iter().filter_map(lowest).map(|z| z * z).sum::<f64>()
        };
        assert!(spread(&with) < 0.8 * spread(&without), "{} {}", spread(&with), spread(&without));
    }
}

#[test]
fn given_noise_levels_and_threads_change_nothing() {
    let made = table(3, BodyKind::Ellipsoid);
    let sigmas = localized(&made.scene, options(false, BodyKind::Ellipsoid)).noise;
    let of = |threads: usize| {
        let options = MapOptions { sigmas: Some(sigmas.clone()), ..options(true, BodyKind::Ellipsoid) };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| localized(&made.scene, options))
    };
    let (one, two) = (of(1), of(2));
    assert_eq!(one.supporting_surfaces.len(), 1);
    assert_eq!(one.supporting_surfaces, two.supporting_surfaces);
    let bodies = |found: &Localization| found.estimates.iter().map(|e| e.body).collect::<Vec<_>>();
    assert_eq!(bodies(&one), bodies(&two));
}

#[test]
fn objects_on_the_ground_plane_are_on_that() {
    let made = table(3, BodyKind::Ellipsoid);
    let on_ground = MapOptions { ground_plane: true, ..options(true, BodyKind::Ellipsoid) };
    assert!(localized(&made.scene, on_ground).supporting_surfaces.is_empty());
}

#[test]
fn scenes_without_up_are_refused() {
    let mut made = table(2, BodyKind::Ellipsoid);
    made.scene.edit(|parts| parts.up = None).unwrap();
    let error = localize(&made.scene, &options(true, BodyKind::Ellipsoid).into()).unwrap_err();
    assert!(error.to_string().contains("supporting surfaces needs an \"up\" direction"), "{error}");
}
