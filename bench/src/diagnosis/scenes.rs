//! Random right scenes.

use quadlift::scene::Scene;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A synthetic scene with the options that it was drawn with.
pub(crate) struct RandomScene {
    pub options: SyntheticOptions,
    pub synthetic: SyntheticScene,
}

impl RandomScene {
    /// The scene of a seed; `None` where an object does not lie in front of its cameras.
    pub(crate) fn draw(seed: u64) -> Option<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let trajectories = [
            Trajectory::default(),
            Trajectory::Arc { span: 20.0 },
            Trajectory::Arc { span: 60.0 },
            Trajectory::Orbit,
            Trajectory::Random,
            Trajectory::Street,
        ];
        let trajectory = trajectories[rng.random_range(0..trajectories.len())];
        let views = [3, 4, 5, 8, 12, 20, 40, 60][rng.random_range(0..8)];
        let objects = [1, 2, 3, 5, 10, 20, 50][rng.random_range(0..7)];
        let noise = [0.0, 0.01, 0.02, 0.05, 0.1][rng.random_range(0..5)];
        let outlier_share = [0.0, 0.05, 0.1, 0.3][rng.random_range(0..4)];
        let options = SyntheticOptions {
            seed,
            objects: if trajectory == Trajectory::Street { views / 3 + 17 } else { objects },
            views,
            trajectory,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(noise)],
            outlier_share,
            ..Default::default()
        };
        let synthetic = generate(&options).ok()?;
        Some(Self { options, synthetic })
    }
}

/// The same scene without ids.
pub(crate) fn without_ids(scene: &Scene) -> Option<Scene> {
    let mut parts = scene.clone().into_parts();
    parts.detections.iter_mut().for_each(|detection| detection.object_index = None);
    parts.object_ids.clear();
    Scene::from_parts(parts).ok()
}
