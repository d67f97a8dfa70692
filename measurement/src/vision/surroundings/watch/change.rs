//! How a whole view is displaced: shift, turn about the line of sight, and scale, fitted to the displacements of
//! patches.
//!
//! **Method:** least squares with weights that fall with the distance from the fit, so that patches on tools, hands and
//! moved props do not count as long as they are a minority. Lens and depth displace patches of one moved camera
//! differently; the tolerance grows with the displacement ([`tolerance`]).

/// Distance from the fit that an image may have at rest: noise, compression and the steps of the search, cells.
const STILL_TOLERANCE: f32 = 0.5;

/// The same as a share of the displacement: things a fifth nearer to the camera are displaced by a fifth more, and the
/// distortion of a wide lens makes displacements at the rim a tenth to a quarter smaller.
const TOLERANCE_SHARE: f32 = 0.2;

/// The largest tolerance, cells: farther away, chance images are found as well.
const MAX_TOLERANCE: f32 = 3.0;

/// Rounds of the weighted fit.
const ROUNDS: usize = 6;

/// Patches that lie closer together than this (root mean square) show no turn and no scale, cells.
const MIN_SPREAD: f32 = 4.0;

/// Largest turn (radians) and largest change of scale of a camera that still shows its box.
const MAX_TURN: f32 = 0.2;

/// The change of a view from one moment to another. Places are relative to the picture's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct ViewChange {
    /// To the right and down, cells.
    shift: [f32; 2],
    /// Change of scale, share.
    zoom: f32,
    /// Clockwise, radians.
    turn: f32,
}

/// A patch's place, and its displacement, cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct PatchShift {
    pub(super) place: [f32; 2],
    pub(super) shift: [f32; 2],
}

impl ViewChange {
    /// A shift by so many cells to the right and down.
    pub(super) fn of_shift(shift: [f32; 2]) -> Self {
        Self { shift, ..Self::default() }
    }

    /// The displacement at a place, cells.
    pub(super) fn at(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let Self { shift: [right, down], zoom, turn } = *self;
        [right + zoom * x - turn * y, down + turn * x + zoom * y]
    }

    /// Its parts as displacements, root mean square over a picture of this size, cells: right, down, turn, scale. The
    /// root mean square of all together is their norm.
    pub(super) fn parts(&self, columns: usize, rows: usize) -> [f32; 4] {
        let radius = ((columns * columns + rows * rows) as f32 / 12.0).sqrt();
        [self.shift[0], self.shift[1], radius * self.turn, radius * self.zoom]
    }

    /// Can a camera have moved so that it still shows its box?
    pub(super) fn is_possible(&self) -> bool {
        self.turn.abs() <= MAX_TURN && self.zoom.abs() <= MAX_TURN
    }

    /// True if the displacement is the one that this change gives its place.
    pub(super) fn explains(&self, found: &PatchShift) -> bool {
        let expected = self.at(found.place);
        distance(found.shift, expected) <= tolerance(expected)
    }

    /// The change that explains most of the displacements, given a change near it.
    pub(super) fn fit(found: &[PatchShift], near: Self) -> Self {
        let off = |axis: usize| median(found.iter().map(|of| of.shift[axis] - near.at(of.place)[axis]).collect());
        let shift = [0, 1].map(|axis| near.shift[axis] + off(axis));
        (0..ROUNDS).fold(Self { shift, ..near }, |change, _| change.refit(found))
    }

    /// Least squares with weights for the distances from this change.
    fn refit(&self, found: &[PatchShift]) -> Self {
        let weight = |of: &PatchShift| {
            let expected = self.at(of.place);
            let far = distance(of.shift, expected) / tolerance(expected);
            1.0 / (1.0 + far * far).powi(2)
        };
        let weights: Vec<f32> = found.iter().map(weight).collect();
        let total = weights.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        let mean = |value: &dyn Fn(&PatchShift) -> f32| {
            found.iter().zip(&weights).map(|(of, weight)| weight * value(of)).sum::<f32>() / total
        };
        let [x, y] = [0, 1].map(|axis| mean(&|of| of.place[axis]));
        let [right, down] = [0, 1].map(|axis| mean(&|of| of.shift[axis]));
        let spread = mean(&|of| (of.place[0] - x).powi(2) + (of.place[1] - y).powi(2)).max(MIN_SPREAD * MIN_SPREAD);
        let parts = |of: &PatchShift| (of.place[0] - x, of.place[1] - y, of.shift[0] - right, of.shift[1] - down);
        let outwards = mean(&|of| {
            let (x, y, right, down) = parts(of);
            x * right + y * down
        });
        let around = mean(&|of| {
            let (x, y, right, down) = parts(of);
            x * down - y * right
        });
        let (zoom, turn) = (outwards / spread, around / spread);
        Self { shift: [right - zoom * x + turn * y, down - turn * x - zoom * y], zoom, turn }
    }
}

/// How far from an expected displacement an image may lie, cells.
pub(super) fn tolerance([right, down]: [f32; 2]) -> f32 {
    (STILL_TOLERANCE + TOLERANCE_SHARE * right.hypot(down)).min(MAX_TOLERANCE)
}

fn distance(one: [f32; 2], other: [f32; 2]) -> f32 {
    (one[0] - other[0]).hypot(one[1] - other[1])
}

/// The median; 0 without values.
fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}
