//! Choice of the source (detector) if a scene has several.

use super::Scene;

/// Why the source of detections cannot be determined.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// Several sources and none chosen.
    #[error(
        "the detections come from several sources ({}); choose one, because some may be made from the truth",
        .0.join(", ")
    )]
    Several(Vec<String>),
    /// The chosen source does not exist.
    #[error(
        "there are no detections of the source \"{chosen}\"; the scene has: {}",
        if .known.is_empty() { "none with a source".to_owned() } else { .known.join(", ") }
    )]
    Unknown {
        /// The requested source.
        chosen: String,
        /// The sources of the scene.
        known: Vec<String>,
    },
}

impl Scene {
    /// Index of the source whose detections count; `None` when the scene has one at most.
    ///
    /// # Errors
    /// [`SourceError`] when `chosen` does not exist, or when it is absent and the scene has several.
    pub fn source_index(&self, chosen: Option<&str>) -> Result<Option<u32>, SourceError> {
        let sources = &self.sources;
        if let Some(name) = chosen {
            let unknown = || SourceError::Unknown { chosen: name.to_owned(), known: sources.clone() };
            return sources.iter().position(|s| s == name).map(|index| Some(index as u32)).ok_or_else(unknown);
        }
        let unnamed = self.detections.iter().any(|d| d.source_index.is_none());
        if sources.len() + usize::from(unnamed && !sources.is_empty()) > 1 {
            let mut names = sources.clone();
            if unnamed {
                names.push("detections without a source".to_owned());
            }
            return Err(SourceError::Several(names));
        }
        Ok(None)
    }
}
