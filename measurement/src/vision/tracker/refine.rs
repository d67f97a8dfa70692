//! Refines a rough tube: probe passes from wide to close, then the fulcrum, the tape's colour, and the band's length.

use super::band_fit::BandFit;
use super::measurement::{Grade, Measurement};
use super::probe_pass::{FINE_PASSES, FoundEdges, ProbePass};
use super::trace::FitRecorder;
use crate::vision::edges::outline_probes::rim_probes;
use crate::vision::edges::subpixel::Fineness;
use crate::vision::pose::TubeEstimate;
use crate::vision::pose::fulcrum::{self, Fulcrum};
use crate::vision::pose::joint_fit::{self, MeasuredEdge, Trust};
use crate::vision::pose::normal_equations::{
    OffsetPriors, own_offsets_of_shaft_px, own_offsets_px, shared_offsets_of_shaft_px, shared_offsets_px, together,
};
use crate::vision::reason::MissReason;
use crate::vision::space::CameraPoint;
use crate::vision::tube::{OutlinePart, Tube};

/// Factor on the variances of a fit that is not good: some edges it used may be false. Three times the standard
/// deviation.
const DOUBT_VARIANCE_FACTOR: f64 = 9.0;

/// Share of the probes that must find an edge in the first pass; with fewer, the region is no tube and the finer
/// passes are skipped.
const MIN_STEP_SHARE: f64 = 0.3;

/// A tube fitted to the edges of one probe pass.
pub(super) struct PassFit {
    pub(super) found: FoundEdges,
    pub(super) estimate: TubeEstimate,
    seen_share: f64,
}

impl BandFit<'_> {
    /// Refines a rough tube with the edges in the pixels.
    pub(super) fn refine(
        &self,
        start: &Tube,
        length_mm: f64,
        passes: &[ProbePass],
        recorder: &mut FitRecorder,
    ) -> Result<Measurement, MissReason> {
        let fit = match self.spec.is_bare() {
            true => self.fit_shaft(start, length_mm, passes, recorder).map_err(|miss| miss.reason),
            false => self.fit_passes(start, length_mm, passes, recorder),
        };
        self.measurement_of(fit?, length_mm)
    }

    /// The measurement by the last fit of a tube.
    pub(super) fn measurement_of(&self, fit: PassFit, length_mm: f64) -> Result<Measurement, MissReason> {
        let PassFit { found, estimate, seen_share } = fit;
        let mut measurement = Measurement {
            estimate,
            length_mm,
            length_sigma_mm: 0.0,
            seen_share,
            ends_seen: found.ends_seen(),
            fulcrum_miss_squared: 0.0,
            smear_px: self.smear_px(),
            continuation: None,
            fitted_edges: Vec::new(),
        };
        self.use_fulcrum(&mut measurement, &found);
        if !self.spec.is_bare() && !self.covers_tape(&measurement.estimate.tube, length_mm) {
            return Err(MissReason::NotTape);
        }
        if measurement.grade() < Grade::Good {
            doubt(&mut measurement.estimate);
        }
        if self.is_length_unknown() {
            self.measure_length(&mut measurement, &found);
        }
        measurement.fitted_edges = found.fitted;
        Ok(measurement)
    }

    /// Fits the tube pass by pass, and returns the last fit.
    pub(super) fn fit_passes(
        &self,
        start: &Tube,
        length_mm: f64,
        passes: &[ProbePass],
        recorder: &mut FitRecorder,
    ) -> Result<PassFit, MissReason> {
        recorder.start_fit(start, length_mm);
        let mut tube = *start;
        let mut last = Err(MissReason::BordersNotFound);
        for pass in passes {
            let fit = self.fit_pass(&tube, length_mm, *pass, recorder)?;
            tube = fit.estimate.tube;
            last = Ok(fit);
        }
        last
    }

    fn fit_pass(
        &self,
        tube: &Tube,
        length_mm: f64,
        pass: ProbePass,
        recorder: &mut FitRecorder,
    ) -> Result<PassFit, MissReason> {
        let found = self.edges_along(tube, length_mm, pass, recorder)?;
        if found.edges.is_empty() {
            return Err(MissReason::BordersNotFound);
        }
        if found.edges.iter().all(|edge| edge.point.part().is_border()) {
            return Err(MissReason::TipHidden);
        }
        self.fit_edges(found, tube, length_mm, pass.fineness, recorder)
    }

    /// Fits the tube to edges of this precision.
    pub(super) fn fit_edges(
        &self,
        found: FoundEdges,
        tube: &Tube,
        length_mm: f64,
        fineness: Fineness,
        recorder: &mut FitRecorder,
    ) -> Result<PassFit, MissReason> {
        let priors = self.offset_priors(&found, tube, length_mm);
        let estimate = joint_fit::fit(&found.edges, tube, self.camera(), Trust::Majority, &priors, None)
            .ok_or(MissReason::BordersNotFound)?;
        recorder.record_fitted_tube(&estimate.tube);
        let seen_share = estimate.support / f64::max(found.visible.0.iter().sum(), 1.0);
        if fineness == Fineness::Step && seen_share < MIN_STEP_SHARE {
            return Err(MissReason::BordersNotFound);
        }
        Ok(PassFit { found, estimate, seen_share })
    }

    /// Measures by how much the axis misses the fulcrum, if it is known, and constrains the tube to it.
    fn use_fulcrum(&self, measurement: &mut Measurement, found: &FoundEdges) {
        let Some(fulcrum) = &self.fulcrum else { return };
        measurement.fulcrum_miss_squared = fulcrum::miss_squared(&measurement.estimate, fulcrum);
        if let Some(bound) = self.constrain_to_fulcrum(found, &measurement.estimate, measurement.length_mm, fulcrum) {
            measurement.estimate = bound;
        }
    }

    /// The estimate, constrained to the fulcrum. The edges of a short visible piece hardly determine its lean, and
    /// errors of the lean are not linear. `None` if the constrained tube does not explain the edges.
    fn constrain_to_fulcrum(
        &self,
        found: &FoundEdges,
        free: &TubeEstimate,
        length_mm: f64,
        fulcrum: &Fulcrum,
    ) -> Option<TubeEstimate> {
        const WORSE: f64 = 2.0;
        const SHARP_PX: f64 = 0.1;
        let axis = (free.tube.tip - fulcrum.at).try_normalize(1e-9).unwrap_or(free.tube.axis);
        let priors = self.offset_priors(found, &free.tube, length_mm);
        let from =
            |start: &Tube| joint_fit::fit(&found.edges, start, self.camera(), Trust::Majority, &priors, Some(fulcrum));
        let bound = from(&Tube { axis, ..free.tube }).or_else(|| from(&free.tube));
        bound.filter(|bound| bound.residual_px < WORSE * free.residual_px.max(SHARP_PX))
    }

    /// Priors on the offsets of a tube's edges: the usual ones, wider where the edges are smeared or the band's length
    /// is uncertain.
    fn offset_priors(&self, found: &FoundEdges, tube: &Tube, length_mm: f64) -> OffsetPriors {
        let px_per_mm = self.px_per_mm_along(tube, length_mm);
        let across = self.px_per_mm_across(tube);
        let (shared, own) = if self.spec.is_bare() {
            (shared_offsets_of_shaft_px(tube.radius * across, across, px_per_mm), own_offsets_of_shaft_px())
        } else {
            (shared_offsets_px(across, px_per_mm), own_offsets_px(across))
        };
        let mut priors = OffsetPriors {
            offsets_px: found.offsets_px(together(shared, own)),
            own_px: found.offsets_px(own),
            length_mm,
            px_per_mm: if self.is_length_unknown() { px_per_mm } else { 0.0 },
        };
        if let Some((_, sigma_mm)) = self.length {
            let proximal_px = &mut priors.offsets_px[OutlinePart::ProximalEnd.index()];
            *proximal_px = proximal_px.hypot(sigma_mm * px_per_mm);
        }
        priors
    }

    /// Does it have a band whose length was not measured?
    fn is_length_unknown(&self) -> bool {
        !self.spec.is_bare() && self.spec.band_length_mm().is_none()
    }

    /// Corrects the band's assumed length by its proximal end, as seen on this frame.
    fn measure_length(&self, measurement: &mut Measurement, found: &FoundEdges) {
        let tube = measurement.estimate.tube;
        measurement.length_mm += self.length_error_mm(found, &tube, measurement.length_mm).unwrap_or(0.0);
        measurement.length_sigma_mm = length_sigma_mm(&measurement.estimate, measurement.length_mm);
    }

    /// By how much the band is longer than assumed, from the edges at its proximal end, mm.
    fn length_error_mm(&self, found: &FoundEdges, tube: &Tube, length_mm: f64) -> Option<f64> {
        let outline = tube.outline()?;
        let residual = |edge: &MeasuredEdge| edge.residual_px(&outline, self.camera());
        let proximal = found.edges.iter().filter(|edge| edge.point.part() == OutlinePart::ProximalEnd);
        let mut offsets: Vec<f64> = proximal.filter_map(residual).collect();
        if self.length.is_none() {
            let mut probes = Vec::new();
            let layout = self.layout(FINE_PASSES[0]);
            rim_probes(&outline, self.camera(), length_mm, 0.5 * length_mm, layout, &mut probes);
            let located = probes.iter().filter_map(|(_, probe)| self.locate(probe, Fineness::Fine));
            offsets.extend(located.map(|edge| edge.offset_px - joint_fit::END_OFFSET_PX));
        }
        offsets.sort_by(f64::total_cmp);
        Some(offsets.get(offsets.len() / 2)? / self.px_per_mm_along(tube, length_mm))
    }

    /// Motion blur of edges across the motion: standard deviation, pixels.
    pub(super) fn smear_px(&self) -> f64 {
        self.motion_px_s.norm() * self.edges.exposure_s / 12f64.sqrt()
    }

    /// Pixels per millimetre across the tube, at its tip.
    pub(super) fn px_per_mm_across(&self, tube: &Tube) -> f64 {
        self.camera().fx / tube.tip.z.max(1.0)
    }

    /// Pixels per millimetre along the axis, at the band's proximal end.
    pub(super) fn px_per_mm_along(&self, tube: &Tube, length_mm: f64) -> f64 {
        let pixel = |back: f64| self.camera().project(CameraPoint(tube.tip - tube.axis * back)).map(|p| p.0);
        let pair = pixel(length_mm).zip(pixel(length_mm + 1.0));
        pair.map_or(1.0, |(near, far)| (near - far).norm()).max(0.05)
    }
}

/// Increases the variances of a fit that is not good.
fn doubt(estimate: &mut TubeEstimate) {
    estimate.covariance *= DOUBT_VARIANCE_FACTOR;
    estimate.lasting *= DOUBT_VARIANCE_FACTOR;
    estimate.equations = estimate.equations.with_variance_scaled(DOUBT_VARIANCE_FACTOR);
}

/// Standard deviation of the band's length as measured by a pose, mm. The visible length is foreshortened by the lean
/// and scaled by the depth, and both are uncertain.
fn length_sigma_mm(pose: &TubeEstimate, length_mm: f64) -> f64 {
    let towards = pose.tube.tip.coords.normalize().dot(&pose.tube.axis).abs().min(0.999);
    let by_lean =
        towards / (1.0 - towards * towards).sqrt() * pose.covariance[(3, 3)].max(pose.covariance[(4, 4)]).sqrt();
    let by_depth = pose.covariance[(2, 2)].sqrt() / pose.tube.tip.z;
    length_mm * by_lean.hypot(by_depth)
}
