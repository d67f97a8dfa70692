//! One plot: maps numbers to picture coordinates, draws axes with round numbers, lines and bands.
//!
//! Elements have classes, and the style sheet gives the colours, so one picture serves light and dark mode and print.
//! Plotting libraries draw fixed colours, and only lines are needed, so none is used.

use std::fmt::Write;

use super::node::{Attributes, Markup, element, text};

/// Width of a picture, in picture units: pixels on a wide page.
pub const WIDTH: f64 = 960.0;

/// Space for the numbers of the axes: left and below.
pub const MARGIN: (f64, f64) = (58.0, 34.0);

/// The range of numbers on an axis; `from` is at the left or bottom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisRange {
    /// Number at the left or bottom.
    pub from: f64,
    /// Number at the right or top.
    pub to: f64,
}

impl AxisRange {
    /// A range that holds all values, with a small margin. Never empty.
    pub fn around(values: impl IntoIterator<Item = f64>) -> AxisRange {
        let (low, high) = values.into_iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low > high { (0.0, 1.0) } else { (low, high) };
        let room = (0.04 * (high - low)).max(1e-3);
        AxisRange { from: low - room, to: high + room }
    }

    /// The same range with this margin on both sides.
    pub fn with_margin(self, room: f64) -> AxisRange {
        AxisRange { from: self.from - room, to: self.to + room }
    }

    /// Length of the range.
    pub fn length(self) -> f64 {
        (self.to - self.from).abs()
    }

    /// About this many round numbers in the range, and the number of decimals that they need.
    pub fn ticks(self, about: f64) -> (Vec<f64>, usize) {
        let rough = self.length() / about;
        let decade = 10_f64.powf(rough.log10().floor());
        let step = decade * [1.0, 2.0, 5.0].into_iter().find(|m| m * decade >= rough).unwrap_or(10.0);
        let (low, high) = (self.from.min(self.to), self.from.max(self.to));
        let first = (low / step).ceil() as i64;
        let last = ((high / step) + 1e-9).floor() as i64;
        let digits = (-(step.log10() + 1e-9).floor()).max(0.0) as usize;
        ((first..=last).map(|n| n as f64 * step).collect(), digits)
    }
}

/// A rectangle of the picture with numbers along two sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panel {
    /// Left edge.
    pub left: f64,
    /// Upper edge.
    pub top: f64,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// Range of the horizontal axis, to the right.
    pub x: AxisRange,
    /// Range of the vertical axis, upwards; downwards if `from` is greater than `to`.
    pub y: AxisRange,
}

impl Panel {
    /// Picture coordinates of a pair of numbers, clamped to the panel.
    pub fn position(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let (across, up) =
            ((x - self.x.from) / (self.x.to - self.x.from), (y - self.y.from) / (self.y.to - self.y.from));
        (self.left + self.width * across.clamp(0.0, 1.0), self.top + self.height * (1.0 - up.clamp(0.0, 1.0)))
    }

    /// Grid, numbers and names of both axes.
    pub fn axes(&self, x_name: &str, y_name: &str) -> Markup {
        group("axes", [self.axes_below(x_name), self.axes_beside(y_name)])
    }

    /// The horizontal axis alone.
    pub fn axes_below(&self, name: &str) -> Markup {
        let bottom = self.top + self.height;
        let (ticks, digits) = self.x.ticks(self.width / 90.0);
        let mut parts = Vec::new();
        for x in ticks {
            let at = self.position((x, 0.0)).0;
            parts.push(line("grid", (at, self.top), (at, bottom)));
            parts.push(label("number middle", (at, bottom + 15.0), &number(x, digits)));
        }
        parts.push(label("name middle", (self.left + 0.5 * self.width, bottom + 31.0), name));
        group("below", parts)
    }

    /// The vertical axis alone, with the frame.
    pub fn axes_beside(&self, name: &str) -> Markup {
        let (ticks, digits) = self.y.ticks((self.height / 26.0).max(2.0));
        let mut parts = vec![self.rectangle("frame", (self.left, self.top), (self.width, self.height))];
        for y in ticks {
            let at = self.position((0.0, y)).1;
            let class = if y.abs() < 1e-12 { "zero" } else { "grid" };
            parts.push(line(class, (self.left, at), (self.left + self.width, at)));
            parts.push(label("number end", (self.left - 6.0, at + 4.0), &number(y, digits)));
        }
        let turned = format!("translate({:.1} {:.1}) rotate(-90)", self.left - 44.0, self.top + 0.5 * self.height);
        parts.push(element("text", &[("class", "name middle"), ("transform", &turned)], [text(name)]));
        group("beside", parts)
    }

    /// A line through the points in order.
    pub fn line(&self, class: &str, points: &[(f64, f64)]) -> Markup {
        path(class, &outline(&self.thinned(points)), "")
    }

    /// The area between two lines with the same x values.
    pub fn band(&self, class: &str, points: &[(f64, f64, f64)]) -> Markup {
        let upper: Vec<_> = points.iter().map(|(x, _, high)| (*x, *high)).collect();
        let lower: Vec<_> = points.iter().map(|(x, low, _)| (*x, *low)).collect();
        let mut round = self.thinned(&upper);
        round.extend(self.thinned(&lower).into_iter().rev());
        path(class, &outline(&round), "Z")
    }

    /// A bar from x to x and y to y.
    pub fn bar(&self, class: &str, (from, to): (f64, f64), (low, high): (f64, f64)) -> Markup {
        let ((left, bottom), (right, top)) = (self.position((from, low)), self.position((to, high)));
        self.rectangle(class, (left, top), ((right - left).max(0.6), bottom - top))
    }

    fn rectangle(&self, class: &str, (left, top): (f64, f64), (width, height): (f64, f64)) -> Markup {
        let [left, top, width, height] = [left, top, width, height].map(|v| format!("{v:.1}"));
        let attributes: Attributes =
            &[("class", class), ("x", &left), ("y", &top), ("width", &width), ("height", &height)];
        element("rect", attributes, [])
    }

    /// Picture coordinates of the points. If there are many, only the first, lowest, highest and last of each picture
    /// column: an hour of video then looks the same and takes no more space than a minute.
    fn thinned(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        const MAX_POINTS: usize = 2000;
        let places: Vec<_> = points.iter().map(|p| self.position(*p)).collect();
        if places.len() <= MAX_POINTS {
            return places;
        }
        let column = |place: &(f64, f64)| place.0.floor();
        let of_column = |group: &[(f64, f64)]| {
            let by_height = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
            let ends = [group.first(), group.iter().min_by(by_height), group.iter().max_by(by_height), group.last()];
            ends.into_iter().flatten().copied().collect::<Vec<_>>()
        };
        places.chunk_by(|a, b| column(a) == column(b)).flat_map(of_column).collect()
    }
}

/// A picture of this height.
pub fn picture(name: &str, height: f64, parts: impl IntoIterator<Item = Markup>) -> Markup {
    let size = format!("0 0 {WIDTH} {height}");
    element("svg", &[("viewBox", &size), ("role", "img"), ("aria-label", name)], parts)
}

/// A group of parts that share a class.
pub fn group(class: &str, parts: impl IntoIterator<Item = Markup>) -> Markup {
    element("g", &[("class", class)], parts)
}

/// A straight line between two points of the picture.
pub fn line(class: &str, from: (f64, f64), to: (f64, f64)) -> Markup {
    path(class, &outline(&[from, to]), "")
}

/// Text at a point of the picture.
pub fn label(class: &str, (u, v): (f64, f64), words: &str) -> Markup {
    let (u, v) = (format!("{u:.1}"), format!("{v:.1}"));
    element("text", &[("class", class), ("x", &u), ("y", &v)], [text(words)])
}

fn path(class: &str, outline: &str, end: &str) -> Markup {
    element("path", &[("class", class), ("d", &format!("{outline}{end}"))], [])
}

fn outline(places: &[(f64, f64)]) -> String {
    let mut outline = String::new();
    for (index, (u, v)) in places.iter().enumerate() {
        let _ = write!(outline, "{}{u:.1} {v:.1}", if index == 0 { 'M' } else { 'L' }); // cannot fail
    }
    outline
}

/// A number with a typographic minus sign.
fn number(value: f64, digits: usize) -> String {
    let value = if value.abs() < 1e-12 { 0.0 } else { value };
    format!("{value:.digits$}").replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn panel() -> Panel {
        let x = AxisRange { from: 0.0, to: 100.0 };
        Panel { left: 50.0, top: 10.0, width: 800.0, height: 100.0, x, y: AxisRange { from: -1.0, to: 1.0 } }
    }

    #[test]
    fn up_is_up_and_points_outside_are_drawn_at_the_edge() {
        assert_eq!(panel().position((0.0, -1.0)), (50.0, 110.0));
        assert_eq!(panel().position((100.0, 1.0)), (850.0, 10.0));
        assert_eq!(panel().position((50.0, 7.0)), (450.0, 10.0));
    }

    #[test]
    fn a_long_line_keeps_its_extremes_and_few_points() {
        let mut points: Vec<(f64, f64)> = (0..100_000).map(|i| (f64::from(i) * 1e-3, 0.0)).collect();
        points[54_321].1 = 1.0;
        points[60_000].1 = -1.0;
        let thinned = panel().thinned(&points);
        assert!(thinned.len() <= 4 * 801, "{}", thinned.len());
        assert!(thinned.iter().any(|p| p.1 == 10.0) && thinned.iter().any(|p| p.1 == 110.0));
    }

    proptest! {
        #[test]
        fn ticks_are_round_and_within(from in -100.0f64..100.0, decade in -2.0f64..4.0) {
            let length = 10_f64.powf(decade);
            let span = AxisRange { from, to: from + length };
            let (ticks, digits) = span.ticks(6.0);
            prop_assert!((2..=14).contains(&ticks.len()), "{ticks:?}");
            for tick in ticks {
                prop_assert!(tick >= from - 1e-6 * length && tick <= from + length * 1.000_001);
                let written: f64 = format!("{tick:.digits$}").parse().unwrap();
                prop_assert!((written - tick).abs() < 1e-3 * length, "{tick} with {digits} digits");
            }
        }
    }
}
