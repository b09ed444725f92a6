//! How many cases a property is tested with.

use proptest::test_runner::Config;

/// So many cases, or as many as the environment variable `PROPTEST_CASES` says: `with_cases` would override it.
pub(crate) fn cases(count: u32) -> Config {
    let cases = if std::env::var_os("PROPTEST_CASES").is_some() { Config::default().cases } else { count };
    Config { cases, ..Config::default() }
}
