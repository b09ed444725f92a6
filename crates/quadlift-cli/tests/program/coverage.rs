//! `quadlift localize --coverage`.

use crate::common::Folder;

#[test]
fn a_result_says_how_its_regions_are_calibrated() {
    let folder = Folder::new();
    let fine = |arguments: &str| {
        let run = folder.run(arguments);
        assert_eq!(run.code, 0, "{}", run.stderr);
        run
    };
    for (name, seed) in [("known.json", 1), ("new.json", 2)] {
        fine(&format!("synth -q -o {name} --objects 30 --views 10 --noise box:0.05 --seed {seed}"));
    }
    fine("localize known.json -o result.json --body ellipsoid");
    let run = fine("localize new.json -o out.json --body ellipsoid --coverage result.json known.json");
    assert!(
        run.stdout.contains("regions calibrated on 30 objects: the 95 % region of a center ends at"),
        "{}",
        run.stdout
    );
    let record = &folder.json("out.json")["localization"]["coverage"];
    assert_eq!(record["objects"], 30);
    assert_eq!((&record["results"][0], &record["truths"][0]), (&"result.json".into(), &"known.json".into()));
    let limit = |part: &str, level: &str| record["squared_distance"][part][level].as_f64();
    let (half, most) = (limit("center", "0.5").unwrap(), limit("center", "0.95").unwrap());
    assert!(0.0 < half && half < most);
    assert_eq!(limit("body", "0.99"), None);
    // The scene that is localized has a truth of its own, which is not looked at: covariances are the same without.
    fine("localize new.json -o plain.json --body ellipsoid");
    assert_eq!(folder.json("out.json")["objects"], folder.json("plain.json")["objects"]);
}

#[test]
fn what_cannot_calibrate_is_refused() {
    let folder = Folder::new();
    let run = folder.run("synth -q -o scene.json --objects 3 --views 4 --noise box:0.05");
    assert_eq!(run.code, 0);
    let run = folder.run("localize scene.json --coverage scene.json scene.json");
    assert_eq!(run.code, 1);
    assert!(run.stderr.contains("no object that is \"ok\" and has a covariance"), "{}", run.stderr);
    let run = folder.run("localize scene.json --method lfd --coverage a.json b.json");
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("--coverage"), "{}", run.stderr);
}
