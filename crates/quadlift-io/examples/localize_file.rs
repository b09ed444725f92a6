//! Localizes the objects of a scene file with the built-in priors on sizes, and writes a scene file with the results.
//!
//!     cargo run --example localize_file -p quadlift-io -- scene.json objects.json

#![allow(clippy::print_stdout, reason = "an example")]

use std::path::PathBuf;

use quadlift::solve::PosteriorOptions;
use quadlift::{LocalizeOptions, localize};
use quadlift_io::{builtin_priors, estimates_to_objects, read_scene_file, write_scene_file};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("usage: localize_file SCENE.json OUT.json".into());
    };
    let file = read_scene_file(&input)?;
    // Mistakes in the file are reported with its name and the entry.
    let scene = file.to_scene().map_err(|error| error.in_file(&input))?;

    let options = LocalizeOptions::from(PosteriorOptions { priors: builtin_priors(), ..Default::default() });
    let result = localize(&scene, &options)?;
    for estimate in &result.estimates {
        println!("{}: {}", scene.object_ids[estimate.object_index], estimate.status.name());
    }
    let objects = estimates_to_objects(&scene, &result).collect();
    write_scene_file(&output, &file.with_results(objects, Default::default()))?;
    Ok(())
}
