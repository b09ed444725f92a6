use super::*;

fn frames(names: &[(&str, Option<&str>)]) -> SceneFile {
    let frame = |(id, image): &(&str, Option<&str>)| FrameRecord {
        id: (*id).to_owned(),
        image: image.map(str::to_owned),
        ..FrameRecord::default()
    };
    SceneFile { frames: names.iter().map(frame).collect(), ..SceneFile::default() }
}

fn ids(ids: &[&str]) -> SceneFile {
    frames(&ids.iter().map(|id| (*id, None)).collect::<Vec<_>>())
}

fn named(names: &[&str]) -> Vec<DetectedImage> {
    let key = |name: &&str| ImageKey { name: Some((*name).to_owned()), ..ImageKey::default() };
    names.iter().map(|name| DetectedImage { key: key(name), detections: Vec::new() }).collect()
}

fn numbered(numbers: impl IntoIterator<Item = i64>) -> Vec<DetectedImage> {
    let key = |number| ImageKey { number: Some(number), ..ImageKey::default() };
    numbers.into_iter().map(|number| DetectedImage { key: key(number), detections: Vec::new() }).collect()
}

const AUTO: MatchOptions =
    MatchOptions { by: MatchBy::Auto, frame_offset: None, time_tolerance: 0.02, numbering: Numbering::Unknown };

fn matched(scene: &SceneFile, images: &[DetectedImage], options: &MatchOptions) -> Vec<Option<usize>> {
    match_frames(scene, images, options).unwrap().frame_of_image
}

#[test]
fn names_match_with_any_folders_and_stems_without_extensions() {
    let scene = frames(&[("left/a.png", Some("../images/left/a.png")), ("right/a.png", None), ("b.JPG", None)]);
    assert_eq!(
        matched(&scene, &named(&["left/a.png", "x\\right\\a.png", "b.JPG", "c.png"]), &AUTO),
        [Some(0), Some(1), Some(2), None]
    );
    // Which of the two is not said.
    assert_eq!(matched(&scene, &named(&["a.png"]), &AUTO), [None]);
    let labels = match_frames(&scene, &named(&["labels/left/a.txt", "b.txt"]), &AUTO).unwrap();
    assert_eq!((labels.by, labels.frame_of_image), (MatchBy::Stem, vec![Some(0), Some(2)]));
    // A frame is one image only.
    assert_eq!(matched(&ids(&["a.png"]), &named(&["x/a.png", "y/a.png"]), &AUTO), [Some(0), None]);
    assert_eq!((stem("12.5"), stem("a.tar.gz"), stem(".txt"), stem("000012")), ("12.5", "a.tar", ".txt", "000012"));
}

#[test]
fn names_that_annotation_tools_gave_match_the_original_ones() {
    let hash = "0123456789abcdef0123456789abcd42";
    let scene = ids(&["images/frame_1.jpg", "images/frame_2.jpg", "left/a.png"]);
    let renamed = |name: &str, extension: &str| format!("train/labels/{name}_jpg.rf.{hash}.{extension}");
    for extension in ["jpg", "txt", "xml"] {
        let [one, two] = [renamed("frame_1", extension), renamed("frame_2", extension)];
        let matching = match_frames(&scene, &named(&[&two, &one, "0a1b2c3d-a.png"]), &AUTO).unwrap();
        assert_eq!((matching.by, matching.frame_of_image), (MatchBy::Name, vec![Some(1), Some(0), Some(2)]));
        assert_eq!(matching.note, None);
    }
    // Images that have the name of the file itself come first, as they do where the exported images were used.
    let exported = ids(&["a.png", "0a1b2c3d-a.png"]);
    assert_eq!(matched(&exported, &named(&["0a1b2c3d-a.png", "a.png"]), &AUTO), [Some(1), Some(0)]);
    // Versions of one image, as augmentation makes them.
    let versions = [renamed("frame_1", "jpg"), renamed("frame_1", "jpg").replace("01", "10")];
    let matching = match_frames(&scene, &named(&[&versions[0], &versions[1]]), &AUTO).unwrap();
    assert_eq!(matching.frame_of_image, [Some(0), None]);
    insta::assert_snapshot!(matching.note.unwrap(), @"1 images are further versions of a frame's image and have no frame: the first version of each was used; export the data set without augmentation");
    // The digits at the end of a hash are no number.
    assert_eq!(number_in(&renamed("frame_12", "jpg")), Some(12));
}

#[test]
fn numbers_are_those_of_the_names_or_places() {
    let kitti = ids(&["000090", "000091", "000092"]);
    let of_names = MatchOptions { numbering: Numbering::OfNames, ..AUTO };
    assert_eq!(matched(&kitti, &numbered([92, 90, 1]), &of_names), [Some(2), Some(0), None]);
    assert_eq!(matched(&kitti, &numbered([92, 90, 1]), &AUTO), [Some(2), Some(0), None]);
    let plain = ids(&["a", "b", "c"]);
    assert_eq!(matched(&plain, &numbered([0, 2, 3]), &AUTO), [Some(0), Some(2), None]);
    // From 1 to the number of frames, and no 0: they count from 1.
    assert_eq!(matched(&plain, &numbered([1, 3]), &AUTO), [Some(0), Some(2)]);
    let from_one = MatchOptions { numbering: Numbering::From(1), ..AUTO };
    assert_eq!(matched(&plain, &numbered([1, 2]), &from_one), [Some(0), Some(1)]);
    // MOT counts from 1; images of ffmpeg do so too, those of KITTI count from 0.
    assert_eq!(matched(&ids(&["f_001", "f_002"]), &numbered([1, 2]), &from_one), [Some(0), Some(1)]);
    assert_eq!(matched(&ids(&["f_000", "f_001"]), &numbered([1, 2]), &from_one), [Some(0), Some(1)]);
    let unclear = match_frames(&kitti, &numbered([91, 92]), &from_one).unwrap_err();
    assert!(unclear.contains("from 91 to 92") && unclear.contains("90 to 92"), "{unclear}");
    let said = MatchOptions { frame_offset: Some(1), ..from_one };
    assert_eq!(matched(&kitti, &numbered([91, 92]), &said), [Some(0), Some(1)]);
    // Detections from 0 and images from 1: both readings are possible.
    assert!(match_frames(&ids(&["f_001", "f_002"]), &numbered([0, 1]), &AUTO).is_err());
    // Names give numbers when that is asked for.
    let index = MatchOptions { by: MatchBy::Index, numbering: Numbering::OfNames, ..AUTO };
    assert_eq!(matched(&ids(&["f_001", "f_002"]), &named(&["video_2.txt", "video_1.txt"]), &index), [Some(1), Some(0)]);
    assert_eq!((number_in("left/a_0012.png"), number_in("12.5"), number_in("a")), (Some(12), None, None));
}

#[test]
fn times_match_the_nearest_frame_within_the_tolerance() {
    let scene = ids(&["10.00", "10.05", "10.10"]);
    let key = |time| ImageKey { time: Some(time), ..ImageKey::default() };
    let images: Vec<DetectedImage> =
        [10.049, 10.052, 10.2, 9.99].map(|time| DetectedImage { key: key(time), detections: Vec::new() }).into();
    // Two images of one frame: the nearer one.
    assert_eq!(matched(&scene, &images, &AUTO), [Some(1), None, None, Some(0)]);
    // Names of labels in nanoseconds, frames in seconds, and the other way round.
    let in_seconds = ids(&["1403636579.763556", "1403636579.813556"]);
    let in_nanoseconds = ids(&["1403636579763555584", "1403636579813555456"]);
    let labels = |scene: &SceneFile| {
        let names: Vec<String> = scene.frames.iter().rev().map(|frame| format!("{}.txt", frame.id)).collect();
        named(&names.iter().map(String::as_str).collect::<Vec<_>>())
    };
    for (scene, labels, unit) in
        [(&in_seconds, labels(&in_nanoseconds), "detections"), (&in_nanoseconds, labels(&in_seconds), "frames")]
    {
        let matching = match_frames(scene, &labels, &AUTO).unwrap();
        assert_eq!((matching.by, matching.frame_of_image), (MatchBy::Time, vec![Some(1), Some(0)]));
        assert!(matching.note.unwrap().ends_with(&format!("; the times of the {unit} are in 1e-9 s")));
    }
    let matching = match_frames(&scene, &named(&["10.1.png"]), &MatchOptions { by: MatchBy::Time, ..AUTO }).unwrap();
    assert_eq!(matching.frame_of_image, [Some(2)]);
}
