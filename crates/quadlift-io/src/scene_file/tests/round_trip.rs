//! Writing and reading is the identity, and no bytes make the reader panic.

use std::path::Path;

use proptest::collection::{btree_map, vec};
use proptest::option;
use proptest::prelude::*;
use proptest::sample::Index;
use serde_json::{Map, Value};

use super::messages::VALID;
use crate::scene_file::*;

fn number() -> impl Strategy<Value = f64> {
    use proptest::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    prop_oneof![POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO, -1000.0..1000.0f64, (-9i32..9).prop_map(f64::from)]
}

fn numbers<const N: usize>() -> impl Strategy<Value = [f64; N]> {
    vec(number(), N).prop_map(|v| std::array::from_fn(|i| v[i]))
}

fn rows() -> impl Strategy<Value = [[f64; 4]; 3]> {
    vec(numbers(), 3).prop_map(|v| [v[0], v[1], v[2]])
}

/// Text with quotes, control characters and letters of all lengths in UTF-8.
fn text() -> impl Strategy<Value = String> {
    prop_oneof!["[a-z0-9]{0,6}", "\\PC{0,4}", Just("null".to_owned()), Just("\"\\\n\u{1F600}".to_owned())]
}

fn name() -> impl Strategy<Value = Box<str>> {
    text().prop_map(Into::into)
}

fn value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        number().prop_map(Value::from),
        text().prop_map(Value::from),
    ];
    leaf.prop_recursive(3, 12, 4, |inner| {
        prop_oneof![
            vec(inner.clone(), 0..4).prop_map(Value::from),
            btree_map(text(), inner, 0..4).prop_map(|map| Value::Object(map.into_iter().collect())),
        ]
    })
}

/// Unknown fields; their names cannot be those of known ones.
fn extra() -> impl Strategy<Value = Map<String, Value>> {
    let fields = btree_map("x_[a-z]{0,3}", value(), 0..3).prop_map(|map| map.into_iter().collect());
    prop_oneof![3 => Just(Map::new()), 1 => fields]
}

fn camera() -> impl Strategy<Value = CameraRecord> {
    (text(), text(), option::of(number()), option::of(number()), vec(number(), 0..5), extra())
        .prop_map(|(id, model, width, height, params, extra)| CameraRecord { id, model, width, height, params, extra })
}

fn depth_image() -> impl Strategy<Value = DepthImageRecord> {
    (text(), number(), option::of(name()), extra()).prop_map(|(path, scale, source, extra)| DepthImageRecord {
        path,
        scale,
        source,
        extra,
    })
}

fn point_cloud() -> impl Strategy<Value = PointCloudRecord> {
    (text(), option::of(name()), option::of(rows()), option::of(name()), extra())
        .prop_map(|(path, frame, transform, source, extra)| PointCloudRecord { path, frame, transform, source, extra })
}

fn frame() -> impl Strategy<Value = FrameRecord> {
    let posed = (option::of(text()), option::of(rows()), option::of(rows()));
    let image = (
        option::of(number()),
        option::of(number()),
        option::of(text()),
        option::of(depth_image().prop_map(Box::new)),
        option::of(number()),
    );
    let pixels = option::of(vec([number(), number()], 0..4));
    let points = (option::of(point_cloud().prop_map(Box::new)), option::of(vec(any::<u32>(), 0..4)), pixels);
    (text(), posed, image, points, extra()).prop_map(|(id, posed, image, points, extra)| {
        let (camera, cam_from_world, projection) = posed;
        let (width, height, image, depth, time) = image;
        let (point_cloud, observed_points, observed_pixels) = points;
        let observed_points = observed_points.map(Into::into);
        let observed_pixels = observed_pixels.map(Into::into);
        FrameRecord {
            id,
            camera,
            cam_from_world,
            projection,
            width,
            height,
            image,
            depth,
            point_cloud,
            observed_points,
            observed_pixels,
            time,
            extra,
        }
    })
}

fn detection() -> impl Strategy<Value = DetectionRecord> {
    let names = (name(), option::of(name()), option::of(name()), option::of(name()));
    let ellipse = (numbers(), numbers(), number(), extra())
        .prop_map(|(center, semi_axes, angle, extra)| Box::new(EllipseRecord { center, semi_axes, angle, extra }));
    let counts =
        prop_oneof![vec(any::<u32>(), 0..4).prop_map(RleCounts::Runs), text().prop_map(RleCounts::Compressed),];
    let rle = (any::<u32>(), any::<u32>(), counts, extra()).prop_map(|(height, width, counts, extra)| RleRecord {
        size: [height, width],
        counts,
        extra,
    });
    let polygons = vec(vec(number(), 0..4), 0..3);
    let mask = (option::of(text()), option::of(any::<u32>()), option::of(rle), option::of(polygons), extra())
        .prop_map(|(path, value, rle, polygons, extra)| Box::new(MaskRecord { path, value, rle, polygons, extra }));
    let levels = (option::of(number()), option::of(number()), option::of(number()), option::of(number()));
    let shares = (option::of(number()), option::of(number()), option::of(number()));
    let segmentation = (text(), text(), option::of(text()), shares, extra()).prop_map(
        |(method, status, reason, (confidence, truncated_by_border, touches_other_masks), extra)| {
            let record = SegmentationRecord {
                method,
                status,
                reason,
                confidence,
                truncated_by_border,
                touches_other_masks,
                extra,
            };
            Box::new(record)
        },
    );
    let turned = (numbers(), numbers(), number(), extra())
        .prop_map(|(center, size, angle, extra)| Box::new(OrientedBoxRecord { center, size, angle, extra }));
    let outline = vec(numbers(), 0..5).prop_map(Vec::into_boxed_slice);
    let outlines = (option::of(outline), option::of(turned));
    let seen = (option::of(ellipse), outlines, option::of(mask), option::of(segmentation));
    (names, option::of(numbers()), seen, levels, extra()).prop_map(
        |(names, bounding_box, (ellipse, (outline, oriented_box), mask, segmentation), levels, extra)| {
            let (frame, object, category, source) = names;
            let (score, occluded, truncated, visible_fraction) = levels;
            DetectionRecord {
                frame,
                object,
                category,
                source,
                score,
                bounding_box,
                ellipse,
                outline,
                oriented_box,
                mask,
                segmentation,
                occluded,
                truncated,
                visible_fraction,
                extra,
                ..Default::default()
            }
        },
    )
}

fn bounds() -> impl Strategy<Value = BoundsRecord> {
    (numbers(), numbers(), numbers(), option::of(numbers()), extra()).prop_map(
        |(center, rotation, half_extents, half_extents_sd, extra)| BoundsRecord {
            center,
            rotation,
            half_extents,
            half_extents_sd,
            extra,
        },
    )
}

fn object() -> impl Strategy<Value = ObjectRecord> {
    let ellipsoid =
        || {
            option::of((numbers(), numbers(), numbers(), extra()).prop_map(|(center, semi_axes, rotation, extra)| {
                EllipsoidRecord { center, semi_axes, rotation, extra }
            }))
        };
    let cuboid =
        || {
            option::of((numbers(), numbers(), numbers(), extra()).prop_map(
                |(center, half_extents, rotation, extra)| CuboidRecord { center, half_extents, rotation, extra },
            ))
        };
    let superellipsoid = || {
        option::of((numbers(), numbers(), numbers(), number(), extra()).prop_map(
            |(center, semi_axes, rotation, support_exponent, extra)| SuperellipsoidRecord {
                center,
                semi_axes,
                rotation,
                support_exponent,
                extra,
            },
        ))
    };
    let cylinder = || {
        option::of((numbers(), numbers(), number(), numbers(), extra()).prop_map(
            |(center, radii, half_height, rotation, extra)| CylinderRecord {
                center,
                radii,
                half_height,
                rotation,
                extra,
            },
        ))
    };
    let body = || {
        let parameters = (option::of(number()), option::of(number()));
        (text(), numbers(), numbers(), numbers(), parameters, extra()).prop_map(
            |(kind, center, rotation, half_extents, (support_exponent, roundness), extra)| BodyRecord {
                kind,
                center,
                rotation,
                half_extents,
                support_exponent,
                roundness,
                extra,
            },
        )
    };
    let alternatives = vec((option::of(body()), number(), extra()), 0..3).prop_map(|found| {
        let alternative = |(body, log_odds, extra)| AlternativeRecord { body, log_odds, extra };
        found.into_iter().map(alternative).collect::<Vec<_>>()
    });
    let bodies = (ellipsoid(), cuboid(), superellipsoid(), cylinder(), option::of(body()));
    let around = (option::of(bounds()), option::of(body()));
    let bodies = (bodies, option::of(body()), around, option::of(numbers()), option::of(numbers()));
    let numbers_of_view = (option::of(number()), option::of(number()), option::of(number()));
    let view = (text(), numbers_of_view, any::<bool>(), option::of(text()), extra()).prop_map(
        |(frame, (residual_px, normalized_residual, predicted_iou), inlier, rejection_reason, extra)| ViewRecord {
            frame,
            residual_px,
            normalized_residual,
            inlier,
            rejection_reason,
            predicted_iou,
            extra,
        },
    );
    let checked = (number(), any::<usize>(), option::of(number()), option::of(text()), extra()).prop_map(
        |(iou, views, edge_error, suspect_view, extra)| {
            Box::new(CrossValidationRecord { iou, views, edge_error, suspect_view, extra })
        },
    );
    let views = (option::of(any::<usize>()), vec(text(), 0..3), vec(view, 0..3), vec(text(), 0..3));
    let covariance = (text(), vec(numbers(), 9), extra()).prop_map(|(coordinates, m, extra)| {
        Box::new(CovarianceRecord { coordinates, matrix: std::array::from_fn(|i| m[i]), extra })
    });
    let names = (text(), option::of(text()), option::of(text()));
    let goodness_of_fit = (number(), number(), extra()).prop_map(|(normalized_residual, relative_residual, extra)| {
        GoodnessOfFitRecord { normalized_residual, relative_residual, extra }
    });
    let residuals = (option::of(number()), option::of(goodness_of_fit), alternatives);
    let figures = (option::of(numbers()), option::of(number()), residuals, option::of(covariance));
    (names, figures, bodies, views, option::of(checked), extra()).prop_map(
        |(names, figures, bodies, views, checked, extra)| {
            let (id, category, status) = names;
            let (center, center_sd, (residual_px, goodness_of_fit, alternatives), covariance) = figures;
            let (bodies, body, (bounds, enclosing), half_extents_sd, rotation_sd_deg) = bodies;
            let (ellipsoid, cuboid, superellipsoid, cylinder, rounded) = bodies;
            let (views_used, views_rejected, view_residuals_px, warnings) = views;
            ObjectRecord {
                id,
                category,
                status,
                center,
                center_sd,
                body: body.map(Box::new),
                half_extents_sd,
                rotation_sd_deg,
                bounds: bounds.map(Box::new),
                enclosing: enclosing.map(Box::new),
                ellipsoid,
                cuboid: cuboid.map(Box::new),
                cylinder: cylinder.map(Box::new),
                superellipsoid: superellipsoid.map(Box::new),
                rounded: rounded.map(Box::new),
                views_used,
                views_rejected,
                residual_px,
                goodness_of_fit,
                alternatives,
                view_residuals_px,
                cross_validation: checked,
                warnings,
                covariance,
                extra,
            }
        },
    )
}

fn cue_source() -> impl Strategy<Value = CueSourceRecord> {
    (option::of(name()), extra()).prop_map(|(scale, extra)| CueSourceRecord { scale, extra })
}

fn scene() -> impl Strategy<Value = SceneFile> {
    let texts = (option::of(text()), option::of(text()), option::of(text()), option::of(numbers()));
    // In a file `null` and an absent field are one.
    let localization = option::of(value()).prop_map(|v| v.filter(|v| !v.is_null()));
    let points =
        (vec(numbers(), 0..3), option::of(point_cloud().prop_map(Box::new)), btree_map(text(), cue_source(), 0..2));
    let lists = (vec(camera(), 0..3), vec(frame(), 0..4), points, vec(detection(), 0..5), vec(object(), 0..3));
    (texts, localization, lists, extra()).prop_map(|(texts, localization, lists, extra)| {
        let (name, length_unit, notes, up) = texts;
        let (cameras, frames, (points, point_cloud, cue_sources), detections, objects) = lists;
        SceneFile {
            name,
            length_unit,
            up,
            notes,
            localization,
            cameras,
            frames,
            cue_sources,
            points,
            point_cloud,
            detections,
            objects,
            extra,
            ..SceneFile::default()
        }
    })
}

fn written(scene: &SceneFile) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_scene(scene, &mut bytes).unwrap();
    bytes
}

/// Everything that a program does with a file it was given.
fn use_bytes(bytes: &[u8]) {
    let path = Path::new("scene.json");
    match parse_scene_file(path, bytes) {
        Ok(file) => {
            let _ = (file.to_scene(), file.to_objects());
            assert_eq!(parse_scene_file(path, &written(&file)).unwrap(), file);
        }
        Err(error) => assert!(error.to_string().starts_with("scene.json:")),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..crate::test_cases::cases(300) })]

    #[test]
    fn what_is_written_is_read_back(scene in scene()) {
        let bytes = written(&scene);
        let back = parse_scene_file(Path::new("scene.json"), &bytes).unwrap();
        prop_assert_eq!(&back, &scene);
        prop_assert_eq!(written(&back), bytes);
    }
}

/// A change of one place of a text.
#[derive(Debug, Clone)]
enum Mutation {
    Set(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    Copy(Index, usize, Index),
    /// Sets one of the digits, which keeps the JSON valid most of the time.
    Digit(Index, u8),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let tokens: [&[u8]; 14] = [
        b"null",
        b"{",
        b"}",
        b"[",
        b"]",
        b",",
        b"\"",
        b"-",
        b"1e308",
        b"0",
        b"\\u0000",
        b"\xEF\xBB\xBF",
        b"true",
        b"\n",
    ];
    let token = proptest::sample::select(tokens.to_vec());
    prop_oneof![
        4 => (any::<Index>(), b'0'..=b'9').prop_map(|(at, digit)| Mutation::Digit(at, digit)),
        1 => (any::<Index>(), any::<u8>()).prop_map(|(at, byte)| Mutation::Set(at, byte)),
        1 => (any::<Index>(), token).prop_map(|(at, token)| Mutation::Insert(at, token.to_vec())),
        1 => (any::<Index>(), 1usize..20).prop_map(|(at, count)| Mutation::Remove(at, count)),
        1 => (any::<Index>(), 1usize..60, any::<Index>()).prop_map(|(from, count, to)| Mutation::Copy(from, count, to)),
    ]
}

fn mutate(bytes: &mut Vec<u8>, mutation: &Mutation) {
    if bytes.is_empty() {
        return;
    }
    let range = |at: &Index, count: usize| {
        let start = at.index(bytes.len());
        start..(start + count).min(bytes.len())
    };
    match mutation {
        Mutation::Set(at, byte) => {
            let at = at.index(bytes.len());
            bytes[at] = *byte;
        }
        Mutation::Insert(at, token) => {
            let at = at.index(bytes.len());
            bytes.splice(at..at, token.iter().copied());
        }
        Mutation::Remove(at, count) => {
            bytes.drain(range(at, *count));
        }
        Mutation::Digit(at, digit) => {
            let digits: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i].is_ascii_digit()).collect();
            if !digits.is_empty() {
                bytes[digits[at.index(digits.len())]] = *digit;
            }
        }
        Mutation::Copy(from, count, to) => {
            let piece = bytes[range(from, *count)].to_vec();
            let to = to.index(bytes.len());
            bytes.splice(to..to, piece);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(1),
        ..crate::test_cases::cases(4000)
    })]

    #[test]
    fn no_bytes_make_the_reader_panic(mutations in vec(mutation(), 1..4)) {
        let mut bytes = VALID.as_bytes().to_vec();
        for mutation in &mutations {
            mutate(&mut bytes, mutation);
        }
        use_bytes(&bytes);
    }
}
