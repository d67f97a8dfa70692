//! Whether the camera moves during a recording, seen from what stands still in the picture.
//!
//! **In:** the frames of a recording; one a second is used. **Out:** a [`ViewShift`] for each of these moments: how the
//! view is displaced since the beginning. **Method:** the picture is divided into patches ([`patch`]). A patch with
//! structure that looks the same for a second is known from then on. Each moment the known patches are looked for: near
//! their last displacement, then unmoved, then after the likeliest shifts of the whole picture ([`search`]). A change
//! of the view ([`change`]) counts if it explains more than half of the known patches that it leaves in the picture (a
//! third if the view stays as it was), if these are spread over the picture, and if hardly any patch is better
//! explained by rest. So tools, hands, moved props and a board that is pushed before walls with structure do not count.
//! **Gives up** (no sample) where hands cover two thirds of the patches, or half of them at a movement, after a
//! movement beyond the search, and on a plain mat: without structure nothing is known, and unknown is not zero. A first
//! view that lasted stays the reference, even if it is never found again.
//!
//! A known patch that is not found for ten moments while the view rests is learned again: a peg was moved there. The
//! others keep their first look, so errors do not add up. Twelve patches stay known in any case, so that patches are
//! learned only before the first sample and where the view is known to rest.
//!
//! **Cost**, from the number of operations: 0.6 ms a second to shrink a 1080p frame, about as much again where the view
//! rests, and up to 3 ms where it is searched for; that is 0.04 to 0.12 ms for each of 30 frames. After ten moments in
//! vain, a search runs at every fourth one. **Memory:** 130 KB, and 40 bytes a second.
//!
//! | file | what |
//! |---|---|
//! | [`patch`] | patches, and where a later picture shows them |
//! | [`change`] | one change of the view for all patches |
//! | [`search`] | likely shifts, if the view has jumped |

mod change;
mod patch;
mod search;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use self::change::{PatchShift, ViewChange, tolerance};
use self::patch::{LumaCells, MIN_LIKENESS, Patch, SIDE};
use crate::vision::frame::Frame;

/// Time between two looks, s. A movement counts from two seconds on, which are three looks.
const INTERVAL_S: f64 = 1.0;

/// Number of patches that a change must explain: a tenth of the 120 of a 16:9 picture. With an error of 0.1 cells each,
/// the shift is known to 0.03 cells.
const MIN_PATCHES: usize = 12;

/// Known patches in the picture for each explained one: more than a third must show that the view is displaced as
/// before, and more than half that it moved. Hands and their shadows often cover half of a box.
const KNOWN_PER_EXPLAINED: [usize; 2] = [3, 2];

/// A part of the picture counts as shown with this many explained patches.
const MIN_PATCHES_OF_QUARTER: usize = 2;

/// Quarters of the picture that must be shown. A tool comes from one side: with its shadow it fills one or two.
const MIN_QUARTERS: usize = 3;

/// Two displacements of the view that differ by no more than this (root mean square) are one, cells: about 1 mm in a
/// box.
const REST: f32 = 0.5;

/// By how much a patch must look more alike unmoved, so that it contradicts a change.
const CLEAR_DIFFERENCE: f32 = 0.1;

/// A change may leave this many explained patches for each patch that contradicts it: a fixed caption or the rim of a
/// lens does not move with the picture.
const EXPLAINED_PER_RESTING: usize = 4;

/// Rounds of looking for the patches and fitting the change: a turn spreads from the middle to the rim.
const ROUNDS: usize = 3;

/// How far from its expected displacement a patch is looked for, cells, besides the tolerance. The search steps by two.
const REACH: f32 = 1.5;

/// A known patch that is not found so often while the view rests shows something else now.
const MAX_MISSES: u32 = 10;

/// After so many moments without a result, the search runs only at every fourth one.
const PATIENCE: u32 = 10;
const SEARCH_EVERY: u32 = 4;

/// After more moments than this without a result, the watch begins anew if the first view did not last: the recording
/// began with something else, such as a hand over the lens.
const MAX_WAIT: u32 = 20;

/// A first view lasts with this many samples: a median over five moments then shows it.
const MIN_LASTING: usize = 5;

/// How the view at one moment is displaced since the beginning, as tangents of angles: displacements in pixels divided
/// by the focal length, root mean square over the picture. Times a depth they are displacements at that depth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewShift {
    /// Presentation time, s.
    pub time_s: f64,
    /// Displacement by shifts to the right and down, by a turn about the line of sight, and by a change of scale. Their
    /// norm is the displacement of the picture.
    pub parts: [f64; 4],
}

/// Watches the view of a recording.
#[derive(Clone, Debug)]
pub struct ViewWatch {
    focal_px: f64,
    last_s: Option<f64>,
    view: KnownView,
    shifts: Vec<ViewShift>,
}

impl ViewWatch {
    /// A watch for frames of a camera with this focal length, pixels.
    pub fn new(focal_px: f64) -> Self {
        Self { focal_px, last_s: None, view: KnownView::default(), shifts: Vec::new() }
    }

    /// Looks at a frame if the interval has passed.
    pub fn sample_frame(&mut self, frame: &Frame<'_>) {
        if self.last_s.is_some_and(|last_s| frame.time_s < last_s + INTERVAL_S) {
            return;
        }
        let before_s = self.last_s.replace(frame.time_s);
        let has_just_learned = self.shifts.is_empty() && self.view.unfound == 0;
        let Some(now) = LumaCells::of(frame) else { return };
        if let Some(change) = self.view.look(&now) {
            let scale = frame.width() as f64 / now.columns as f64 / self.focal_px;
            let parts = change.parts(now.columns, now.rows).map(|cells| scale * f64::from(cells));
            // What is known for the first time looked the same one look before.
            let times_s = before_s.filter(|_| has_just_learned).into_iter().chain([frame.time_s]);
            self.shifts.extend(times_s.map(|time_s| ViewShift { time_s, parts }));
        } else if self.shifts.len() < MIN_LASTING && self.view.unfound > MAX_WAIT {
            self.view = KnownView::default();
            self.shifts.clear();
        }
    }

    /// The samples so far, in time order.
    pub fn shifts(&self) -> &[ViewShift] {
        &self.shifts
    }

    /// Adds a sample without a picture.
    #[cfg(test)]
    pub fn push_shift(&mut self, shift: ViewShift) {
        self.shifts.push(shift);
    }

    /// The samples, in time order.
    pub fn into_shifts(self) -> Vec<ViewShift> {
        self.shifts
    }
}

/// What is known of a view, and how it was displaced last.
#[derive(Clone, Debug, Default)]
struct KnownView {
    places: Vec<PatchPlace>,
    change: ViewChange,
    /// Moments without a result since the last one with a result.
    unfound: u32,
}

/// A place of the picture, and the patch that was learned there.
#[derive(Clone, Debug)]
struct PatchPlace {
    /// Column and row of its first cell.
    corner: [usize; 2],
    patch: Option<Patch>,
    /// True once the patch looked the same at another moment.
    is_known: bool,
    misses: u32,
}

impl KnownView {
    /// How the view is displaced now; `None` if this is unknown.
    fn look(&mut self, now: &LumaCells) -> Option<ViewChange> {
        if self.places.is_empty() {
            self.places = places(now);
        }
        if self.known().count() < MIN_PATCHES {
            self.learn(now);
            if self.known().count() < MIN_PATCHES {
                return None;
            }
        }
        let Some(change) = self.find(now) else {
            self.unfound += 1;
            return None;
        };
        (self.change, self.unfound) = (change, 0);
        if change.is_near(&ViewChange::default(), now) {
            self.learn(now);
        }
        Some(change)
    }

    fn known(&self) -> impl Iterator<Item = &Patch> {
        self.places.iter().filter(|place| place.is_known).filter_map(|place| place.patch.as_ref())
    }

    /// Looks near the last displacement, then unmoved, then after likely shifts.
    fn find(&self, now: &LumaCells) -> Option<ViewChange> {
        let known: Vec<&Patch> = self.known().collect();
        let near = |start| find_change(&known, now, (start, self.change));
        let as_before = near(self.change);
        let is_search = self.unfound < PATIENCE || self.unfound.is_multiple_of(SEARCH_EVERY);
        if as_before.is_some() || !is_search {
            return as_before;
        }
        let likely = || search::likely_shifts(&known, now).into_iter().map(ViewChange::of_shift).find_map(near);
        near(ViewChange::default()).or_else(likely)
    }

    /// Learns the patches of a view that rests: confirms those that look as before, and learns the others again, except
    /// for the last ones that are needed to find the view.
    fn learn(&mut self, now: &LumaCells) {
        let change = self.change;
        // With too few known patches, no result was given yet: all of them may be learned again.
        let mut spare = self.known().count().checked_sub(MIN_PATCHES).unwrap_or(usize::MAX);
        for place in &mut self.places {
            let likeness = |patch: &Patch| patch.likeness(now, change.at(middle(patch, now)));
            if place.patch.as_ref().and_then(likeness).is_some_and(|likeness| likeness >= MIN_LIKENESS) {
                (place.is_known, place.misses) = (true, 0);
                continue;
            }
            place.misses += 1;
            let is_forgotten = place.is_known && place.misses >= MAX_MISSES && spare > 0;
            spare -= usize::from(is_forgotten);
            if !place.is_known || is_forgotten {
                let patch = Patch::learn(now, place.corner);
                *place = PatchPlace { corner: place.corner, patch, is_known: false, misses: 0 };
            }
        }
    }
}

/// The places of patches in a picture, side by side, at even cells and two cells from the rim at least.
fn places(picture: &LumaCells) -> Vec<PatchPlace> {
    let firsts = |size: usize| {
        let count = size.saturating_sub(4) / SIDE;
        let first = (size - count * SIDE) / 4 * 2;
        (0..count).map(move |index| first + index * SIDE)
    };
    let corners = firsts(picture.rows).flat_map(|y| firsts(picture.columns).map(move |x| [x, y]));
    corners.map(|corner| PatchPlace { corner, patch: None, is_known: false, misses: 0 }).collect()
}

/// A patch's middle relative to the picture's.
fn middle(patch: &Patch, picture: &LumaCells) -> [f32; 2] {
    let [x, y] = patch.corner.map(|first| first + 0.5 * (SIDE - 1) as f32);
    [x - 0.5 * (picture.columns - 1) as f32, y - 0.5 * (picture.rows - 1) as f32]
}

impl ViewChange {
    /// Does it displace the picture as another change does?
    fn is_near(&self, other: &Self, picture: &LumaCells) -> bool {
        let [own, others] = [self, other].map(|change| change.parts(picture.columns, picture.rows));
        let squares = own.iter().zip(others).map(|(own, other)| (own - other).powi(2));
        squares.sum::<f32>().sqrt() <= REST
    }
}

/// The change near `start` that explains the known patches, given the last one; `None` if none explains enough of them.
fn find_change(known: &[&Patch], now: &LumaCells, (start, last): (ViewChange, ViewChange)) -> Option<ViewChange> {
    let mut change = start;
    let mut found = Vec::new();
    for _ in 0..ROUNDS {
        let shift = |patch: &&Patch| {
            let place = middle(patch, now);
            let expected = change.at(place);
            let shift = patch.follow(now, expected, REACH + tolerance(expected))?;
            Some(PatchShift { place, shift })
        };
        found = known.iter().filter_map(shift).collect();
        if found.len() < MIN_PATCHES {
            return None;
        }
        change = ViewChange::fit(&found, change);
    }
    found.retain(|of| change.explains(of));
    is_explanation((&change, &last), &found, known, now).then_some(change)
}

/// Do the patches that a change explains prove it, given the last change?
fn is_explanation(
    (change, last): (&ViewChange, &ViewChange),
    explained: &[PatchShift],
    known: &[&Patch],
    now: &LumaCells,
) -> bool {
    let likeness = |patch: &&Patch| patch.likeness(now, change.at(middle(patch, now)));
    let in_picture = known.iter().filter(|patch| likeness(patch).is_some()).count();
    let quarter = |right: bool, down: bool| {
        let is_there = |of: &&PatchShift| (of.place[0] > 0.0) == right && (of.place[1] > 0.0) == down;
        explained.iter().filter(is_there).count() >= MIN_PATCHES_OF_QUARTER
    };
    let quarters = [(false, false), (false, true), (true, false), (true, true)];
    let is_spread = quarters.into_iter().filter(|(right, down)| quarter(*right, *down)).count() >= MIN_QUARTERS;
    let per_explained = if change.is_near(last, now) { KNOWN_PER_EXPLAINED[0] } else { KNOWN_PER_EXPLAINED[1] };
    let is_enough = explained.len() >= MIN_PATCHES && per_explained * explained.len() > in_picture;
    if !(change.is_possible() && is_enough && is_spread) {
        return false;
    }
    let rests = |patch: &&&Patch| {
        let unmoved = patch.likeness(now, [0.0; 2]).unwrap_or(0.0);
        unmoved >= MIN_LIKENESS && unmoved > likeness(patch).unwrap_or(0.0) + CLEAR_DIFFERENCE
    };
    change.is_near(&ViewChange::default(), now)
        || EXPLAINED_PER_RESTING * known.iter().filter(rests).count() <= explained.len()
}
