#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use quadlift_experiments::*;
fn main() {
    let name = std::env::args().nth(1).unwrap();
    let e = Experiment::ALL[["synthetic", "accv", "tuw", "kitti", "minimal"].iter().position(|n| *n == name).unwrap()];
    let t = std::time::Instant::now();
    let r = run(e, Some(std::path::Path::new("/work/shared/data")), 0, &|_, _, _| {}).unwrap();
    println!("{}", r.to_text());
    for p in r.plots() {
        std::fs::write(format!("/tmp/exp/{}.svg", p.name), p.svg().unwrap()).unwrap();
        std::fs::write(format!("/tmp/exp/{}.png", p.name), p.png().unwrap()).unwrap();
    }
    println!("{}", summary(&[r]).to_text());
    println!("{:?}", t.elapsed());
}
