//! Worlds turned at random: real objects and cameras stand along the axes of their worlds, which no program should gain from.

use quadlift::geometry::{quaternion_from_rotation, rotation_from_quaternion};
use quadlift::nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use quadlift_io::SceneFile;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::sets::SceneCase;

/// The scene and its truth in a world that is turned about its origin, by another rotation for each seed.
pub(super) fn turned(scene: &SceneCase, seed: u64) -> SceneCase {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let axis = Unit::new_normalize(Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)));
    let rotation = Rotation3::from_axis_angle(&axis, rng.random_range(0.0..std::f64::consts::TAU));
    let [input, truth] = [&scene.input, &scene.truth].map(|file| turned_file(file.clone(), &rotation));
    SceneCase { name: scene.name.clone(), input, truth, counted: scene.counted.clone() }
}

fn turned_file(mut file: SceneFile, rotation: &Rotation3<f64>) -> SceneFile {
    let inverse = rotation.inverse();
    for frame in &mut file.frames {
        for matrix in [&mut frame.cam_from_world, &mut frame.projection].into_iter().flatten() {
            let left: Matrix3<f64> = Matrix3::from_fn(|row, column| matrix[row][column]) * inverse.matrix();
            for (row, numbers) in matrix.iter_mut().enumerate() {
                numbers[..3].copy_from_slice(left.row(row).transpose().as_slice());
            }
        }
    }
    let place = |point: &mut [f64; 3]| *point = (rotation * Vector3::from(*point)).into();
    file.points.iter_mut().chain(&mut file.up).for_each(place);
    for object in &mut file.objects {
        object.center.iter_mut().for_each(place);
        let poses = object.ellipsoid.iter_mut().map(|body| (&mut body.center, &mut body.rotation));
        let poses = poses.chain(object.cuboid.iter_mut().map(|body| (&mut body.center, &mut body.rotation)));
        for (center, turn) in poses.chain(object.cylinder.iter_mut().map(|body| (&mut body.center, &mut body.rotation)))
        {
            place(center);
            if let Some(axes) = rotation_from_quaternion(*turn) {
                *turn = quaternion_from_rotation(&(rotation * axes));
            }
        }
    }
    file
}

#[cfg(test)]
mod tests {
    use quadlift::geometry::project_ellipsoid;

    use super::*;
    use crate::compare::sets::synthetic;

    #[test]
    fn objects_look_the_same_in_a_turned_world() {
        let scene = &synthetic(1).unwrap()[0].scenes[0];
        let other = turned(scene, 3);
        let outlines = |file: &SceneFile| -> Vec<_> {
            let (seen, objects) = (file.to_scene().unwrap(), file.to_objects().unwrap());
            let of = |body: &quadlift::geometry::Ellipsoid| {
                project_ellipsoid(&seen.frames[0].projection, body).unwrap().center()
            };
            objects.iter().map(|object| of(&object.body().unwrap().closest_ellipsoid())).collect()
        };
        for (before, after) in outlines(&scene.truth).iter().zip(outlines(&other.truth)) {
            assert!((before - after).norm() < 1e-6, "{before} {after}");
        }
        assert_ne!(scene.input.frames[0].cam_from_world, other.input.frames[0].cam_from_world);
        assert_ne!(scene.truth.objects[0].ellipsoid, other.truth.objects[0].ellipsoid);
    }
}
