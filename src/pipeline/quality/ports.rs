//! Has the camera moved since it was calibrated? The trocars, which stay where they are, tell.
//!
//! **In:** the fulcrums of earlier sessions of one box and one calibration, and those of the session that is judged, all in
//! the camera's frame. **Out:** [`Placement`]: how far each tool's fulcrum lies from the box's nearest port, with its error,
//! and whether all lie elsewhere as one rigid motion would have it (the camera has moved) or one alone does (a port has).
//! **Method:** [`Ports`] are medians over sessions ([`Ports::of_sessions`]), so that a session that was odd itself moves none
//! of them. A tool belongs to the nearest port whatever its name: tools that change hands have moved nothing. **Gives up**
//! (`None`) with fewer than [`FEWEST`] sessions at a port, and on fulcrums that are not known well.
//!
//! What a moved camera spoils is only where things are: its lens is still as calibrated, so that lengths, speeds and all
//! features of one session are right. Paths of different days no longer lie in one frame.

use nalgebra::{Matrix3, Point3, Vector3};

use super::limits::MOVED_MM;
use super::quantile;
use crate::pipeline::pose::fulcrum::Fulcrum;

/// Sessions that a port must have been seen in: the median of three is none of two that disagree.
pub const FEWEST: usize = 3;

/// Sessions that ports are made of, at most: the median of 20 is known more than three times as well as one session. They are
/// the first ones after the calibration in which nothing had moved, so that slow sagging adds up against them, and what has moved
/// is said until somebody mends it; the last ones would take over the new place and fall silent.
pub const MOST: usize = 20;

/// Standard deviations beyond which a shift is none of chance: in space, as rare as three are on a line (0.27 %).
const SURE: f64 = 3.76;

/// A fulcrum belongs to a port of earlier sessions that is so near, mm: trocars are put farther apart than this, and
/// a session that lies farther off is none that a median should have to bear.
const ONE_PORT_MM: f64 = 25.0;

/// Beyond that a tool came through another port than any that is known, mm: no port moves so far, and a camera that does is
/// told by all tools together.
const ANOTHER_PORT_MM: f64 = 2.0 * ONE_PORT_MM;

/// A median's variance over a mean's.
const MEDIAN_COST: f64 = std::f64::consts::FRAC_PI_2;

/// Where a box's trocars are, as its earlier sessions have it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ports(Vec<Fulcrum>);

/// How far something lies from where it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// How far, mm.
    pub mm: f64,
    /// Its standard deviation along itself, mm.
    pub sigma_mm: f64,
}

/// Where a session's tools came from, against the box's ports.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Placement {
    /// The camera has moved, by as much as the trocar that seems to have moved most.
    pub camera: Option<Shift>,
    /// Of each tool, its trocar's distance from the nearest port; `None` where either is not known.
    pub tools: Vec<Option<Shift>>,
}

impl Shift {
    /// Is it larger than what its own error makes?
    pub fn is_sure(&self) -> bool {
        self.mm > SURE * self.sigma_mm
    }

    /// Is it sure, and larger than what matters?
    pub fn is_moved(&self) -> bool {
        self.is_sure() && self.mm > MOVED_MM
    }
}

impl Placement {
    /// By how much a tool's trocar alone lies elsewhere; `None` where it does not, or the camera has moved.
    pub fn port(&self, tool: usize) -> Option<Shift> {
        let shift = self.tools.get(tool).copied().flatten();
        shift.filter(|shift| self.camera.is_none() && shift.is_moved())
    }
}

impl Ports {
    /// Ports that are known already.
    pub fn new(ports: Vec<Fulcrum>) -> Self {
        Self(ports)
    }

    /// The ports.
    pub fn all(&self) -> &[Fulcrum] {
        &self.0
    }

    /// The ports that the sessions share: each fulcrum joins the nearest one's, or begins another.
    pub fn of_sessions(sessions: &[Vec<Fulcrum>]) -> Self {
        let mut seen: Vec<Vec<Fulcrum>> = Vec::new();
        for session in sessions.iter().take(MOST) {
            let first: Vec<Point3<f64>> = seen.iter().map(|of_port| of_port[0].at).collect();
            let near = |tool: &Fulcrum| Some(tool).map(|tool| tool.at);
            let ports = nearest(&session.iter().map(near).collect::<Vec<_>>(), &first);
            for (fulcrum, port) in session.iter().zip(ports) {
                match port.filter(|port| (fulcrum.at - first[*port]).norm() < ONE_PORT_MM) {
                    Some(port) => seen[port].push(*fulcrum),
                    None => seen.push(vec![*fulcrum]),
                }
            }
        }
        Self(seen.iter().filter(|of_port| of_port.len() >= FEWEST).filter_map(|of_port| median(of_port)).collect())
    }

    /// Where a session's tools came from.
    pub fn place(&self, tools: &[Option<Fulcrum>]) -> Placement {
        let at: Vec<Option<Point3<f64>>> = tools.iter().map(|tool| tool.map(|fulcrum| fulcrum.at)).collect();
        let ports = nearest(&at, &self.0.iter().map(|port| port.at).collect::<Vec<_>>());
        let pairs: Vec<Option<(Fulcrum, Fulcrum)>> =
            tools.iter().zip(ports).map(|(tool, port)| Some((self.0[port?], (*tool)?))).collect();
        let known: Vec<(Fulcrum, Fulcrum)> = pairs.iter().copied().flatten().collect();
        let camera = camera(&known);
        let shift = |pair: Option<(Fulcrum, Fulcrum)>| {
            pair.and_then(|(port, now)| between(&port, &now))
                .filter(|shift| camera.is_some() || shift.mm < ANOTHER_PORT_MM)
        };
        Placement { camera, tools: pairs.into_iter().map(shift).collect() }
    }
}

/// How far the camera has moved, if that is what every trocar says: all are elsewhere, and as far from each other as before.
fn camera(pairs: &[(Fulcrum, Fulcrum)]) -> Option<Shift> {
    let shifts: Vec<Shift> = pairs.iter().map(|(port, now)| between(port, now)).collect::<Option<_>>()?;
    let most = shifts.iter().copied().max_by(|a, b| a.mm.total_cmp(&b.mm)).filter(Shift::is_moved)?;
    // Turned, a camera leaves one trocar nearer to its place than another, but none where it was.
    let are_all = shifts.iter().all(|shift| shift.is_sure() && shift.mm > 0.5 * MOVED_MM);
    let mut two = pairs.iter().enumerate().flat_map(|(i, one)| pairs[i + 1..].iter().map(move |other| (one, other)));
    (pairs.len() > 1 && are_all && two.all(|(one, other)| is_rigid(one, other))).then_some(most)
}

/// Are two trocars as far apart as before?
fn is_rigid(one: &(Fulcrum, Fulcrum), other: &(Fulcrum, Fulcrum)) -> bool {
    let apart =
        |a: &Fulcrum, b: &Fulcrum| Fulcrum { at: Point3::from(a.at - b.at), covariance: a.covariance + b.covariance };
    let (before, now) = (apart(&one.0, &other.0), apart(&one.1, &other.1));
    let [was, is] = [&before, &now].map(|apart| apart.at.coords.norm());
    let sigma = |apart: &Fulcrum| sigma_along(&apart.covariance, &apart.at.coords).unwrap_or(f64::INFINITY);
    (is - was).abs() < (SURE * sigma(&before).hypot(sigma(&now))).max(0.5 * MOVED_MM)
}

/// `None` where a covariance is none.
fn between(port: &Fulcrum, now: &Fulcrum) -> Option<Shift> {
    let shift = now.at - port.at;
    let sigma_mm = sigma_along(&(port.covariance + now.covariance), &shift)?;
    Some(Shift { mm: shift.norm(), sigma_mm })
}

fn sigma_along(covariance: &Matrix3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let along = direction.try_normalize(1e-9).unwrap_or(Vector3::x());
    let variance = along.dot(&(covariance * along));
    (variance > 0.0).then(|| variance.sqrt())
}

/// The port of each tool: the nearest pairs first, no port twice.
fn nearest(tools: &[Option<Point3<f64>>], ports: &[Point3<f64>]) -> Vec<Option<usize>> {
    let distance = |(tool, port): (usize, usize)| Some(((tools[tool]? - ports[port]).norm(), tool, port));
    let pairs = (0..tools.len()).flat_map(|tool| (0..ports.len()).map(move |port| (tool, port)));
    let mut pairs: Vec<(f64, usize, usize)> = pairs.filter_map(distance).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken: Vec<Option<usize>> = vec![None; tools.len()];
    for (_, tool, port) in pairs {
        if taken[tool].is_none() && !taken.contains(&Some(port)) {
            taken[tool] = Some(port);
        }
    }
    taken
}

/// The median place, with what is left of the sessions' own errors.
fn median(fulcrums: &[Fulcrum]) -> Option<Fulcrum> {
    let axis = |axis: usize| quantile(fulcrums.iter().map(|fulcrum| fulcrum.at[axis]).collect(), 0.5);
    let count = fulcrums.len() as f64;
    let mean: Matrix3<f64> = fulcrums.iter().map(|fulcrum| fulcrum.covariance).sum::<Matrix3<f64>>() / count;
    Some(Fulcrum { at: Point3::new(axis(0)?, axis(1)?, axis(2)?), covariance: mean * (MEDIAN_COST / count) })
}

#[cfg(test)]
mod tests;
