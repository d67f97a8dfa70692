//! Rough tubes from a region's coarse borders and ends: the starts for the fit to the pixels.

use nalgebra::{Point2, Point3, Vector2};

use super::band_fit::BandFit;
use super::measurement::Measurement;
use crate::vision::edges::line_fit::{self, BorderLine};
use crate::vision::edges::outline_probes::OutlinePoint;
use crate::vision::edges::scan_lines::CoarseBand;
use crate::vision::edges::shaft;
use crate::vision::pose::joint_fit::{self, MeasuredEdge, Trust};
use crate::vision::pose::normal_equations::OffsetPriors;
use crate::vision::pose::{TubeEstimate, band_length};
use crate::vision::space::{CameraPoint, Normalised, Pixel};
use crate::vision::tube::{BorderSide, Tube};

/// Standard deviation of a border point or end found with the colour table, pixels.
const COARSE_SIGMA_PX: f64 = 0.7;

impl BandFit<'_> {
    /// The starts for a region, the most certain first; the tube from the taper only if there are no others.
    pub(super) fn starts(&self, coarse: &CoarseBand, ends: [Normalised; 2], by_taper: Option<Tube>) -> Vec<Tube> {
        let depths = [Some(self.depth_by_width(coarse)), self.last_depth_mm];
        let mut starts: Vec<Tube> =
            depths.iter().flatten().filter_map(|depth| self.start_from_fulcrum(ends, *depth)).collect();
        starts.extend(self.starts_from_length(coarse, ends));
        if starts.is_empty() {
            starts.extend(by_taper);
        }
        starts
    }

    /// Depth of a tube that faces the camera and looks as wide as the band, mm.
    fn depth_by_width(&self, coarse: &CoarseBand) -> f64 {
        2.0 * self.radius_mm() * self.camera().fx / coarse.width_px + self.radius_mm()
    }

    /// A start whose axis passes through the known fulcrum and one visible end. It needs neither the taper nor both
    /// ends, and its lean is unambiguous.
    fn start_from_fulcrum(&self, [distal, proximal]: [Normalised; 2], depth: f64) -> Option<Tube> {
        let (fulcrum, (length_mm, _), radius) = (self.fulcrum?.at, self.length?, self.radius_mm());
        let (at_distal, at_proximal) = (Point3::from(distal.ray() * depth), Point3::from(proximal.ray() * depth));
        let in_sight = |point: Point3<f64>| {
            self.camera().project(CameraPoint(point)).is_some_and(|pixel| self.scene.is_visible(point, pixel))
        };
        let from_hand = |point: Point3<f64>| (point - fulcrum).try_normalize(1e-9);
        let (tip, axis) = if in_sight(at_distal) || !in_sight(at_proximal) {
            (at_distal, from_hand(at_distal)?)
        } else {
            let axis = from_hand(at_proximal)?;
            (at_proximal + axis * length_mm, axis)
        };
        Some(Tube { tip, axis, radius })
    }

    /// Starts from a joint fit to the coarse borders and ends, if the band's length is known. The lean from the slight
    /// taper of the borders is rough; the one from the length is not. The length alone cannot distinguish leaning away
    /// from leaning towards the camera, so both are returned, the better one first.
    fn starts_from_length(&self, coarse: &CoarseBand, ends: [Normalised; 2]) -> Vec<Tube> {
        let Some((length_mm, _)) = self.length else { return Vec::new() };
        let radius = self.radius_mm();
        let depth = self.depth_by_width(coarse);
        let fits = [1.0, -1.0].into_iter().filter_map(|sign| {
            let start = band_length::leaning(ends, depth, length_mm, radius, sign)?;
            let edges = self.coarse_edges(coarse, &start, length_mm)?;
            joint_fit::fit(&edges, &start, self.camera(), Trust::All, &OffsetPriors::usual(length_mm), None)
        });
        let mut fits: Vec<TubeEstimate> = fits.collect();
        fits.sort_by(|a, b| a.residual_px.total_cmp(&b.residual_px));
        fits.iter().map(|fit| fit.tube).collect()
    }

    /// The border points and ends of the scan lines, as edges of a tube's outline.
    fn coarse_edges(&self, coarse: &CoarseBand, tube: &Tube, length_mm: f64) -> Option<Vec<MeasuredEdge>> {
        let pixel = |point| self.camera().project(CameraPoint(point)).map(|p| p.0);
        let outline = tube.outline()?;
        let (tip, back) = (pixel(outline.rim(0.0, 0.0))?, pixel(outline.rim(length_mm, 0.0))?);
        let along = (tip - back).try_normalize(1e-9)?;
        let to_first =
            pixel(outline.border(BorderSide::First, 0.5 * length_mm))? - pixel(outline.rim(0.5 * length_mm, 0.0))?;
        let edge = |place, at: Pixel, outward| MeasuredEdge::new(place, at, outward, COARSE_SIGMA_PX, self.camera());
        let back_mm = 0.5 * length_mm; // in the middle, where taper has no effect
        let mut edges = Vec::with_capacity(2 * coarse.borders[0].len() + 2);
        let across = Vector2::new(-along.y, along.x);
        for border in &coarse.borders {
            let outward = if across.dot(&(border.first()?.0 - tip)) < 0.0 { -across } else { across };
            let side = if outward.dot(&to_first) < 0.0 { BorderSide::Second } else { BorderSide::First };
            edges.extend(border.iter().filter_map(|at| edge(OutlinePoint::Border { side, back_mm }, *at, outward)));
        }
        let [first, second] = coarse.ends;
        let (distal, proximal) = if (first.0 - second.0).dot(&along) > 0.0 { (first, second) } else { (second, first) };
        edges.extend(edge(OutlinePoint::Rim { back_mm: 0.0, across: 0.0 }, distal, along));
        edges.extend(edge(OutlinePoint::Rim { back_mm: length_mm, across: 0.0 }, proximal, -along));
        Some(edges)
    }

    /// The band with its borders moved to those of the shaft behind it, if the shaft seems wider than the band.
    pub(super) fn as_wide_as_shaft(&self, coarse: &CoarseBand, found: &Measurement) -> Option<CoarseBand> {
        /// Least difference, as a share of the width and in pixels: several times the error of a border.
        const MIN_SHARE: f64 = 0.08;
        const MIN_PX: f64 = 1.5;
        let (tube, length_mm) = (&found.estimate.tube, found.length_mm);
        let is_visible = |place, at| self.scene.is_visible(place, at);
        let outwards_px =
            shaft::border_offsets_px(self.scene.frame, self.camera(), self.edges, tube, length_mm, is_visible)?
                .map(|px| px.max(0.0));
        let outline = tube.outline()?;
        let pixel = |side| self.camera().project(CameraPoint(outline.border(side, 0.5 * length_mm)));
        let [first, second] = [pixel(BorderSide::First)?.0, pixel(BorderSide::Second)?.0];
        let (outward, width_px) = ((first - second).normalize(), (first - second).norm());
        if outwards_px.iter().all(|px| *px < (MIN_SHARE * width_px).max(MIN_PX)) {
            return None;
        }
        let [by_first, by_second] = [outward * outwards_px[0], -outward * outwards_px[1]];
        let middle = nalgebra::center(&first, &second);
        let moved = |border: &Vec<Pixel>| {
            let is_first = border.first().is_some_and(|at| (at.0 - middle).dot(&outward) > 0.0);
            border.iter().map(|at| Pixel(at.0 + if is_first { by_first } else { by_second })).collect()
        };
        Some(CoarseBand {
            borders: [moved(&coarse.borders[0]), moved(&coarse.borders[1])],
            ends: coarse.ends.map(|end| Pixel(end.0 + 0.5 * (by_first + by_second))),
            axis: coarse.axis,
            width_px: coarse.width_px + outwards_px[0] + outwards_px[1],
        })
    }

    pub(super) fn border_lines(&self, coarse: &CoarseBand) -> Option<[BorderLine; 2]> {
        let line = |border: &Vec<Pixel>| {
            let sights: Vec<Point2<f64>> =
                border.iter().filter_map(|p| self.camera().normalised_of(*p)).map(|n: Normalised| n.0).collect();
            line_fit::fit(&sights)
        };
        Some([line(&coarse.borders[0])?, line(&coarse.borders[1])?])
    }
}
