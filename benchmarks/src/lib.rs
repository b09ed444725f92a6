//! The benchmarks are in `benches/`; a package needs a library or a program.
