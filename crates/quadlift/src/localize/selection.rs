//! Which detections of which objects a localization uses.

use super::options::LocalizeOptions;
use crate::scene::frame_names::natural_places;
use crate::scene::{Detection, ObjectViews, Scene, SkippedDetections, SourceError};
use crate::sorting::StableSort;

/// The objects of a scene, and the detections of theirs that are used.
pub(super) struct Selection<'a> {
    pub scene: &'a Scene,
    options: &'a LocalizeOptions,
    source: Option<u32>,
    /// Index of each listed object in the scene, in the order of their ids, whatever that of the file. Objects of other sources are not
    /// listed; objects whose detections are all skipped are.
    pub objects: Vec<usize>,
    /// For each object of the scene, the detections that are used, in the order of their frames.
    groups: Vec<Vec<u32>>,
    /// For each detection of the scene, the edges that nearer objects hide.
    hidden: Vec<[bool; 4]>,
    /// Skipped detections.
    pub skipped: SkippedDetections,
}

impl<'a> Selection<'a> {
    pub(super) fn new(scene: &'a Scene, options: &'a LocalizeOptions) -> Result<Self, SourceError> {
        let source = scene.source_index(options.source.as_deref())?;
        let (objects, groups, hidden) = Default::default();
        let mut selection =
            Self { scene, options, source, objects, groups, hidden, skipped: SkippedDetections::default() };
        let mut groups = scene.detections_by_object(|d| selection.is_used(d) && selection.is_usable(d));
        // In the order of the frames, so that neighbors in the list are neighbors in time.
        for group in &mut groups {
            group.stable_sort_by_key(|&index| scene.detections[index as usize].frame_index);
        }
        selection.groups = groups;
        // The closed forms do not use them.
        let uses_hidden_edges = options.method.posterior_options().is_some_and(|map| map.occluded_edges);
        selection.hidden = scene.occluded_edges(|d| uses_hidden_edges && selection.is_of_source(d));
        selection.count();
        Ok(selection)
    }

    fn is_of_source(&self, detection: &Detection) -> bool {
        self.source.is_none() || detection.source_index == self.source
    }

    /// The detections of the chosen source.
    pub(super) fn of_source(&self) -> Vec<usize> {
        let detections = self.scene.detections.iter().enumerate();
        detections.filter(|(_, detection)| self.is_of_source(detection)).map(|(index, _)| index).collect()
    }

    fn is_visible(&self, detection: &Detection) -> bool {
        let within = |level: Option<f64>, limit: Option<f64>| limit.is_none_or(|l| level.is_none_or(|x| x <= l));
        within(detection.occluded, self.options.max_occluded) && within(detection.truncated, self.options.max_truncated)
    }

    /// Whether a detection is one of the chosen source that is visible enough.
    pub(super) fn is_used(&self, detection: &Detection) -> bool {
        self.is_of_source(detection) && self.is_visible(detection)
    }

    /// Whether it has what the method can use; with a 3D box alone only the refinement can.
    fn is_measured(&self, d: &Detection) -> bool {
        let refines = self.options.method.posterior_options().is_some();
        d.bounding_box.is_some() || d.ellipse.is_some() || (refines && d.is_measured())
    }

    fn is_usable(&self, detection: &Detection) -> bool {
        self.is_measured(detection) && self.options.measurements.are_in(detection)
    }

    /// Lists the objects and counts what is skipped.
    fn count(&mut self) {
        let mut named = vec![false; self.scene.object_ids.len()];
        let mut skipped = SkippedDetections::default();
        for detection in self.scene.detections.iter().filter(|d| self.is_of_source(d)) {
            let Some(object) = detection.object_index else {
                skipped.without_object += 1;
                continue;
            };
            named[object as usize] = true;
            let (visible, measured) = (self.is_visible(detection), self.is_measured(detection));
            skipped.occluded_or_truncated += usize::from(!visible);
            skipped.beyond_lens += usize::from(visible && !measured);
            skipped.without_measurement += usize::from(visible && measured && !self.is_usable(detection));
        }
        let ids: Vec<&str> = self.scene.object_ids.iter().map(String::as_str).collect();
        let places = natural_places(&ids);
        self.objects = (0..named.len()).filter(|&object| named[object]).collect();
        self.objects.stable_sort_by_key(|&object| places[object]);
        self.skipped = skipped;
    }

    /// The views of a listed object, as the options have them; none if there are too few.
    pub(super) fn views_of(&self, k: usize) -> ObjectViews {
        let posterior_options = self.options.method.posterior_options();
        let group = &self.groups[self.objects[k]];
        let mut object = self.scene.object_views(self.objects[k], group);
        for (view, &detection) in object.views.iter_mut().zip(group) {
            view.occluded_edges = self.hidden[detection as usize];
        }
        object.views.iter_mut().for_each(|view| self.options.measurements.keep_only(view));
        // The closed forms use the border as it is; the refinement accounts for detector errors near it.
        if let Some(posterior_options) = posterior_options {
            object.views.iter_mut().for_each(|view| *view = view.within_margin(posterior_options.border_margin));
        }
        // With a cue, or with a size and the ground, one view is enough for the refinement.
        let least = if posterior_options.is_some() { 1 } else { self.options.method.min_views() };
        if object.views.len() < self.options.min_views.max(least) {
            // Too few views: the solvers return a status.
            object.views.clear();
        }
        object
    }

    /// The frames of the detections of a listed object.
    pub(super) fn frames_of(&self, k: usize) -> impl Iterator<Item = usize> + '_ {
        let group = &self.groups[self.objects[k]];
        group.iter().map(|&d| self.scene.detections[d as usize].frame_index as usize)
    }
}
