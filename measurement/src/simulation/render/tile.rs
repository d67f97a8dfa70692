//! Cuts the picture into tiles: most of them never change, and are not traced again.

/// Pixels along a tile; even, so that a chroma sample never straddles two.
pub const TILE: usize = 16;

/// How a picture is cut into tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiling {
    /// Picture width, pixels.
    pub width: usize,
    /// Picture height, pixels.
    pub height: usize,
    /// Tiles in a row.
    pub columns: usize,
    /// Rows of tiles.
    pub rows: usize,
}

/// One tile's pixels: `left..right`, `top..bottom`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileBounds {
    /// First column.
    pub left: usize,
    /// First row.
    pub top: usize,
    /// One past the last column.
    pub right: usize,
    /// One past the last row.
    pub bottom: usize,
}

impl Tiling {
    /// The tiling of a picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    /// The pixels of tile number `index`, counted along rows.
    pub fn square(&self, index: usize) -> TileBounds {
        let (left, top) = ((index % self.columns) * TILE, (index / self.columns) * TILE);
        TileBounds { left, top, right: (left + TILE).min(self.width), bottom: (top + TILE).min(self.height) }
    }

    /// A tile with `more` extra pixels on each side, row by row; beyond the picture's edge the last pixels repeat.
    pub fn patch<T>(&self, square: TileBounds, more: usize, at: impl Fn(usize, usize) -> T) -> Vec<T> {
        let side = TILE + 2 * more;
        let mut patch = Vec::with_capacity(side * side);
        for row in 0..side {
            let v = (square.top + row).saturating_sub(more).min(self.height - 1);
            patch
                .extend((0..side).map(|column| at((square.left + column).saturating_sub(more).min(self.width - 1), v)));
        }
        patch
    }

    /// Number of tiles.
    pub fn count(&self) -> usize {
        self.columns * self.rows
    }
}

impl TileBounds {
    /// Its pixels, row by row.
    pub fn pixels(self) -> impl Iterator<Item = (usize, usize)> {
        (self.top..self.bottom).flat_map(move |v| (self.left..self.right).map(move |u| (u, v)))
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.right - self.left, self.bottom - self.top)
    }
}
