//! The page: the built viewer (`assets/viewer.html`, from `viewer/`) with the data of a report in it.

use crate::data::Report;

/// The built viewer.
const VIEWER: &str = include_str!("../assets/viewer.html");

/// The element of the viewer that takes the data.
const PLACE: &str = "<script type=\"application/json\" id=\"report-data\"></script>";

/// The size of a page without data, in bytes.
pub(crate) const EMPTY_PAGE: usize = VIEWER.len();

/// A report as one HTML file that needs nothing else.
///
/// # Errors
/// Text when the data cannot be expressed as JSON (a key of a map that is no text; reports have none).
pub fn page(report: &Report) -> Result<String, serde_json::Error> {
    Ok(page_with(&json_for_html(report)?))
}

/// The data as JSON that cannot be parsed as HTML: `<` occurs only in texts and is escaped.
pub(crate) fn json_for_html(report: &impl serde::Serialize) -> Result<String, serde_json::Error> {
    Ok(serde_json::to_string(report)?.replace('<', "\\u003c"))
}

/// The viewer with this JSON.
fn page_with(json: &str) -> String {
    let (before, after) = VIEWER.split_once(PLACE).unwrap_or((VIEWER, ""));
    let (open, close) = PLACE.split_at(PLACE.len() - "</script>".len());
    [before, open, json, close, after].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_viewer_has_one_place_for_the_data_and_keeps_its_license() {
        assert_eq!(VIEWER.matches(PLACE).count(), 1);
        assert!(VIEWER.contains("three.js authors") && VIEWER.contains("Permission is hereby granted"));
        assert!(VIEWER.contains("default-src 'none'; script-src 'sha256-"), "the policy names the script");
        // Nothing is fetched.
        for attribute in ["src=\"http", "href=\"http", "@import", "url(http"] {
            assert!(!VIEWER.contains(attribute), "{attribute}");
        }
    }

    #[test]
    fn texts_cannot_leave_the_data() {
        let hostile = "</script><script>alert(1)</script><!-- <b>&amp;\u{2028}\"'";
        let report = Report { title: hostile.to_owned(), ..Default::default() };
        let page = page(&report).unwrap();
        let start = page.find(&PLACE[..PLACE.len() - "</script>".len()]).unwrap() + PLACE.len() - "</script>".len();
        let data = &page[start..];
        let data = &data[..data.find("</script>").unwrap()];
        assert!(!data.contains('<'), "{data}");
        let back: serde_json::Value = serde_json::from_str(data).unwrap();
        assert_eq!(back["title"], hostile);
        assert_eq!(page.matches("<script").count(), VIEWER.matches("<script").count());
    }
}
