//! A grey picture with fractional levels: it can be smoothed, halved, and read between its pixels.

use crate::vision::frame::Plane;

/// Grey levels 0–255, row by row without gaps.
pub(super) struct Grey {
    pub data: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

impl Grey {
    pub fn from_plane(plane: &Plane<'_>) -> Self {
        let data = (0..plane.height).flat_map(|y| plane.row(y)).map(|&v| f32::from(v)).collect();
        Self { data, width: plane.width, height: plane.height }
    }

    /// Half as wide and high, each pixel the mean of four: pixel `x` here is centred on `2x + ½` there.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            let (upper, lower) = (self.row(2 * y), self.row(2 * y + 1));
            data.extend((0..width).map(|x| {
                let (a, b) = (2 * x, 2 * x + 1);
                (upper[a] + upper[b] + lower[a] + lower[b]) * 0.25
            }));
        }
        Self { data, width, height }
    }

    /// Smoothed by a Gaussian of √2 px (two binomial filters of five taps).
    pub fn smoothed(&self) -> Self {
        self.binomial().binomial()
    }

    /// One pass of 1 4 6 4 1 in both directions; the two outermost pixels on each side stay as they are.
    pub fn binomial(&self) -> Self {
        let (width, height) = (self.width, self.height);
        let mut across = self.data.clone();
        for (row, out) in self.data.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
            for (taps, value) in row.windows(5).zip(&mut out[2..]) {
                *value = (taps[0] + taps[4] + 4.0 * (taps[1] + taps[3]) + 6.0 * taps[2]) * (1.0 / 16.0);
            }
        }
        let mut data = across.clone();
        for y in 2..height.saturating_sub(2) {
            let [a, b, c, d, e] = [y - 2, y - 1, y, y + 1, y + 2].map(|r| &across[r * width..(r + 1) * width]);
            for (x, value) in data[y * width..(y + 1) * width].iter_mut().enumerate() {
                *value = (a[x] + e[x] + 4.0 * (b[x] + d[x]) + 6.0 * c[x]) * (1.0 / 16.0);
            }
        }
        Self { data, width, height }
    }

    pub fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.width + x]
    }

    /// The level between pixels, bilinear; `None` outside the centres of the outermost pixels.
    pub fn between(&self, x: f64, y: f64) -> Option<f32> {
        let inside = x >= 0.0 && y >= 0.0 && x < (self.width - 1) as f64 && y < (self.height - 1) as f64;
        if !inside {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let (fx, fy) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let upper = self.at(left, top) * (1.0 - fx) + self.at(left + 1, top) * fx;
        let lower = self.at(left, top + 1) * (1.0 - fx) + self.at(left + 1, top + 1) * fx;
        Some(upper * (1.0 - fy) + lower * fy)
    }
}
