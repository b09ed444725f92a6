//! KITTI with simulated cues: cars that a detector has found in several images, and labeled cars in one.

use std::path::Path;

use quadlift::geometry::{Body, BodyKind, BoundingBox, ConvexBody, Projection};
use quadlift::metrics::iou3d_ellipsoids;
use quadlift::nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};
use quadlift::scene::{Cues, Detection, NewDetection, Scene, SceneBuilder};
use quadlift::solve::{PosteriorOptions, Status};
use quadlift::synthetic::{Box3dNoise, CueOptions, DepthNoise, simulate_cues};
use quadlift::{LocalizeOptions, localize};
use quadlift_io::builtin_priors;
use rayon::prelude::*;

use crate::data::TrueScene;
use crate::error::Error;
use crate::kitti::{AVERAGED, CAMERA_HEIGHT, cars, protocol};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, average, pooled};
use crate::table::{Cell, Table};

/// What is known besides boxes: the last two with a shift of the depths of [`SHIFT`].
const CUES: [&str; 6] = ["boxes", "+ depth", "+ 3D boxes", "+ both", "+ depth, shift of 1 m", "+ both, shift of 1 m"];

/// Shift of the depths in the last rows, meters.
const SHIFT: f64 = 1.0;

/// Distances that separate the columns of single images, meters.
const DISTANCES: [f64; 4] = [0.0, 15.0, 30.0, 60.0];

/// Seeds of the simulated cues.
const SEEDS: u64 = 5;

fn options_of(cues: usize) -> CueOptions {
    let depth = match cues {
        1 | 3 => Some(DepthNoise::default()),
        4 | 5 => Some(DepthNoise { shift: SHIFT, ..Default::default() }),
        _ => None,
    };
    CueOptions { depth, box3d: matches!(cues, 2 | 3 | 5).then(Box3dNoise::default) }
}

/// Adds the tables of KITTI.
pub(super) fn run(data: &Path, run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", CUES.len() * 2, run.progress);
    let seeds = run.scenes(SEEDS);
    let scenes: Vec<TrueScene> = AVERAGED
        .iter()
        .map(|name| TrueScene::read(data, &format!("kitti_{name}_aligned"), name))
        .collect::<Result<_, _>>()?;
    let measures = [Measure::O3d, Measure::CuboidIou, Measure::CenterWithin(1.0)];
    let titles = ["known"].into_iter().map(str::to_owned).chain(measures.map(Measure::name));
    let mut table = Table::new(
        format!(
            "KITTI, RRC boxes, aligned poses, simulated cues: averages over {} and {seeds} seeds",
            AVERAGED.join(", ")
        ),
        titles,
    );
    for (index, name) in CUES.iter().enumerate() {
        let of_seed = |k: u64| scores(&scenes, &options_of(index), run.seed.wrapping_add(k));
        let all: Vec<_> = (0..seeds).into_par_iter().map(of_seed).collect::<Result<_, _>>()?;
        steps.done();
        let figure = |measure: Measure| {
            let of_scene = |scene: usize| all.iter().flat_map(|seed: &Vec<_>| measure.values(&seed[scene])).collect();
            average(&(0..scenes.len()).map(of_scene).collect::<Vec<Vec<f64>>>())
        };
        let cells = measures.iter().map(|measure| Cell::figure(figure(*measure), measure.decimals()));
        table.push(std::iter::once(Cell::from(*name)).chain(cells).collect());
        if index == 0 || index == 3 {
            report.headlines.extend(figure(Measure::O3d).map(|ours| Headline {
                id: if index == 0 { "cues_kitti_boxes" } else { "cues_kitti_both" },
                what: format!("O3D, KITTI, RRC boxes, aligned poses, {name}"),
                paper: None,
                ours,
                row: "posterior, cuboid, car prior".to_owned(),
                decimals: 3,
            }));
        }
    }
    report.table(table);
    let ranges = DISTANCES.windows(2).map(|w| format!("{} to {} m", w[0], w[1]));
    let mut table = Table::new(
        "KITTI, one labeled image, car prior and ground: median error of the center, meters",
        ["known".to_owned()].into_iter().chain(ranges).chain([
            "all".to_owned(),
            "without an answer, %".to_owned(),
            Measure::O3d.name(),
        ]),
    );
    let images = single_images(&data.join("kitti_object_subset"))?;
    for (index, name) in CUES.iter().enumerate() {
        let of_image =
            |(k, image): (usize, &SingleImage)| errors(image, &options_of(index), run.seed.wrapping_add(k as u64));
        let all: Vec<CarScore> =
            images.par_iter().enumerate().map(of_image).collect::<Result<Vec<_>, Error>>()?.concat();
        steps.done();
        let median = |low: f64, high: f64| {
            let mut found: Vec<f64> =
                all.iter().filter(|car| (low..high).contains(&car.distance)).filter_map(|car| car.error).collect();
            found.sort_by(f64::total_cmp);
            found.get(found.len() / 2).map(|value| Figure { value: *value, standard_error: None })
        };
        let missing = all.iter().filter(|car| car.error.is_none()).count() as f64 / all.len().max(1) as f64;
        let name = if index == 0 { "box alone" } else { name };
        let row = std::iter::once(Cell::from(name))
            .chain(DISTANCES.windows(2).map(|w| Cell::figure(median(w[0], w[1]), 2)))
            .chain([Cell::figure(median(0.0, f64::INFINITY), 2), Cell::number(100.0 * missing, 1)])
            .chain([Cell::figure(pooled(&[all.iter().map(|car| car.o3d).collect()]), 3)]);
        table.push(row.collect());
    }
    report.table(table);
    Ok(())
}

/// The scores of the cars of each sequence with simulated cues.
fn scores(
    scenes: &[TrueScene],
    cues: &CueOptions,
    seed: u64,
) -> Result<Vec<Vec<quadlift::metrics::ObjectScore>>, Error> {
    let mut options = LocalizeOptions::from(cars(BodyKind::Cuboid));
    protocol("rrc", seed)(&mut options);
    let of_scene = |scene: &TrueScene| {
        let body_of = |_: usize, detection: &Detection| {
            let id = &scene.scene.object_ids[detection.object_index? as usize];
            scene.truth.iter().find(|object| &object.id == id)?.cuboid
        };
        let scene = TrueScene { scene: simulate_cues(&scene.scene, body_of, cues, seed)?, ..scene.clone() };
        scene.scores(&options)
    };
    scenes.iter().map(of_scene).collect()
}

/// One image of KITTI with labeled cars.
struct SingleImage {
    projection: Projection,
    /// Box and true body of each car.
    cars: Vec<(BoundingBox, Body)>,
}

/// The images with cars that are neither cut off nor much hidden; files that cannot be parsed are left out.
fn single_images(folder: &Path) -> Result<Vec<SingleImage>, Error> {
    let Ok(entries) = std::fs::read_dir(folder.join("label_2")) else { return Ok(Vec::new()) };
    let mut names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    names.sort();
    let read = |name: &std::ffi::OsString| {
        let labels = std::fs::read_to_string(folder.join("label_2").join(name)).ok()?;
        let calibration = std::fs::read_to_string(folder.join("calib").join(name)).ok()?;
        let numbers = calibration.lines().find_map(|line| line.strip_prefix("P2:"))?;
        let numbers: Vec<f64> = numbers.split_whitespace().filter_map(|x| x.parse().ok()).collect();
        let projection =
            Projection::from_matrix((numbers.len() == 12).then(|| Matrix3x4::from_row_slice(&numbers))?).ok()?;
        let cars: Vec<_> = labels.lines().filter_map(car).collect();
        (!cars.is_empty()).then_some(SingleImage { projection, cars })
    };
    Ok(names.iter().filter_map(read).collect())
}

/// Box and body of a line of a label file: type, truncated, occluded, alpha, box, height, width, length, bottom center, yaw.
fn car(line: &str) -> Option<(BoundingBox, Body)> {
    let numbers: Vec<f64> = line.strip_prefix("Car ")?.split_whitespace().filter_map(|x| x.parse().ok()).collect();
    let [truncated, occluded, _, x0, y0, x1, y1, height, width, length, x, y, z, yaw, ..] = numbers[..] else {
        return None;
    };
    if truncated > 0.0 || occluded > 1.0 {
        return None;
    }
    // Of the car: length along x, width along y, height up; the camera's y points down.
    let (sin, cos) = yaw.sin_cos();
    let columns = [Vector3::new(cos, 0.0, -sin), Vector3::new(sin, 0.0, cos), Vector3::new(0.0, -1.0, 0.0)];
    let rotation = Rotation3::from_matrix_unchecked(quadlift::nalgebra::Matrix3::from_columns(&columns));
    let half_extents = Vector3::new(length, width, height) * 0.5;
    let body = Body { kind: BodyKind::Cuboid, center: Point3::new(x, y - 0.5 * height, z), half_extents, rotation };
    Some((BoundingBox::new([x0, y0, x1, y1]).ok()?, body))
}

/// A car of a single image.
#[derive(Debug, Clone)]
struct CarScore {
    distance: f64,
    /// Error of the center; absent where there is no answer.
    error: Option<f64>,
    /// 0 where there is no answer.
    o3d: f64,
}

/// The scores of the cars of an image.
fn errors(image: &SingleImage, cues: &CueOptions, seed: u64) -> Result<Vec<CarScore>, Error> {
    let mut builder = SceneBuilder::new("image");
    builder.up([0.0, -1.0, 0.0])?;
    builder.add_frame("image", image.projection, Some([1242.0, 375.0]))?;
    for (index, (bounding_box, _)) in image.cars.iter().enumerate() {
        builder.add_detection(&NewDetection {
            frame: "image",
            object: Some(&index.to_string()),
            category: Some("car"),
            bounding_box: Some(*bounding_box),
            cues: Cues::default(),
            ..Default::default()
        })?;
    }
    let scene: Scene = builder.build();
    let scene = simulate_cues(&scene, |index, _| Some(image.cars[index].1), cues, seed)?;
    let map = PosteriorOptions {
        body: Some(BodyKind::Cuboid),
        priors: builtin_priors(),
        camera_height: Some(CAMERA_HEIGHT),
        ..Default::default()
    };
    let found = localize(&scene, &LocalizeOptions { seed, ..map.into() })?;
    let error = |(index, (_, body)): (usize, &(BoundingBox, Body))| {
        let estimate = &found.estimates[index];
        let found = estimate.body.filter(|_| estimate.status == Status::Ok);
        CarScore {
            distance: body.center.coords.norm(),
            error: found.map(|found| (found.center() - body.center).norm()),
            o3d: found.map_or(0.0, |found| iou3d_ellipsoids(&found.closest_ellipsoid(), &body.closest_ellipsoid())),
        }
    };
    Ok(image.cars.iter().enumerate().map(error).collect())
}
