//! Detects whether the camera or a trocar has moved since the calibration, from the positions of the trocars.
//!
//! **In:** the fulcrums of earlier sessions of one box and one calibration, and those of the judged session, all in the
//! camera's frame. **Out:** [`PortPlacement`]: the distance of each tool's fulcrum from the box's nearest port, with
//! its error, and whether all fulcrums are displaced as in one rigid motion (the camera has moved) or only one is (a
//! port has moved). **Method:** [`Ports`] are medians over sessions ([`Ports::of_sessions`]), so that one unusual
//! session does not shift them. A tool belongs to the nearest port, regardless of its name: tools that change hands are
//! not a displacement. **Gives up** (`None`) with fewer than [`MIN_SESSIONS`] sessions at a port, and on fulcrums that
//! are not well known.
//!
//! A moved camera only changes positions: while its lens is as calibrated, lengths, speeds and all features of one
//! session stay right, but paths of different days are no longer in one frame. The trocars cannot say whether the lens
//! is the same, since another box displaces them too ([`mod@super::box_match`]).

pub mod watch;

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::limits::MAX_DISPLACEMENT_MM;
use crate::numbers::quantile::quantile;
use crate::vision::pose::fulcrum::Fulcrum;

/// Minimum number of sessions with a port: the median of three sessions outvotes one that differs.
pub const MIN_SESSIONS: usize = 3;

/// Maximum number of sessions used for the ports: the median of 20 is known more than three times as well as one
/// session. The first sessions after the calibration without a displacement are used. So slow sagging adds up against
/// them, and a displacement is reported until it is corrected; with the last sessions the new position would soon count
/// as normal.
pub const MAX_SESSIONS: usize = 20;

/// A displacement beyond this many standard deviations is not chance: in space this is as rare as three standard
/// deviations in one dimension (0.27 %).
const SIGNIFICANT_SIGMAS: f64 = 3.76;

/// A fulcrum within this distance of a port of earlier sessions belongs to it, mm: trocars are placed farther apart
/// than this, and a session that lies farther off must not enter the median.
const SAME_PORT_MM: f64 = 25.0;

/// Beyond this distance a tool used a port that is not known yet, mm. No port moves so far, and a camera that moved so
/// far shows in all tools together.
const OTHER_PORT_MM: f64 = 2.0 * SAME_PORT_MM;

/// Variance of a median relative to that of a mean.
const MEDIAN_VARIANCE_RATIO: f64 = std::f64::consts::FRAC_PI_2;

/// Positions of a box's trocars, from earlier sessions.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ports(Vec<Fulcrum>);

/// How far something has moved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Displacement {
    /// Distance, mm.
    pub mm: f64,
    /// Standard deviation of the distance, along its direction, mm.
    pub sigma_mm: f64,
}

/// Positions of a session's trocars relative to the box's ports.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PortPlacement {
    /// Set if the camera has moved: the displacement of the trocar that seems to have moved most.
    pub camera: Option<Displacement>,
    /// For each tool: its trocar's distance from the nearest port; `None` if either is unknown.
    pub tools: Vec<Option<Displacement>>,
}

/// How a session's trocars lie to the box's ports, all together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PortAgreement {
    /// Fewer than two trocars are known, or one is in place and another is not.
    #[default]
    Unknown,
    /// All are in place: at least two, since one may coincide by chance.
    InPlace,
    /// All are displaced by one rigid motion; the largest displacement.
    Moved(Displacement),
    /// All are displaced, and their distances from each other differ; the smallest displacement.
    Rearranged(Displacement),
}

impl PortAgreement {
    /// The displacement, if all trocars are displaced.
    pub fn displacement(&self) -> Option<Displacement> {
        match self {
            PortAgreement::Unknown | PortAgreement::InPlace => None,
            PortAgreement::Moved(shift) | PortAgreement::Rearranged(shift) => Some(*shift),
        }
    }
}

impl Displacement {
    /// True if it is larger than its own error can explain.
    pub fn is_significant(&self) -> bool {
        self.mm > SIGNIFICANT_SIGMAS * self.sigma_mm
    }

    /// True if it is significant and larger than [`MAX_DISPLACEMENT_MM`].
    pub fn has_moved(&self) -> bool {
        self.is_significant() && self.mm > MAX_DISPLACEMENT_MM
    }
}

impl PortPlacement {
    /// The displacement of a tool's trocar alone; `None` if it has not moved, or if the camera has.
    pub fn port(&self, tool: usize) -> Option<Displacement> {
        let shift = self.tools.get(tool).copied().flatten();
        shift.filter(|shift| self.camera.is_none() && shift.has_moved())
    }
}

impl Ports {
    /// From known ports.
    pub fn new(ports: Vec<Fulcrum>) -> Self {
        Self(ports)
    }

    /// The ports.
    pub fn all(&self) -> &[Fulcrum] {
        &self.0
    }

    /// The ports that the sessions share: each fulcrum joins the nearest port or starts a new one.
    pub fn of_sessions(sessions: &[Vec<Fulcrum>]) -> Self {
        let mut seen: Vec<Vec<Fulcrum>> = Vec::new();
        for session in sessions.iter().take(MAX_SESSIONS) {
            let first: Vec<Point3<f64>> = seen.iter().map(|of_port| of_port[0].at).collect();
            let near = |tool: &Fulcrum| Some(tool).map(|tool| tool.at);
            let ports = assign_ports(&session.iter().map(near).collect::<Vec<_>>(), &first);
            for (fulcrum, port) in session.iter().zip(ports) {
                match port.filter(|port| (fulcrum.at - first[*port]).norm() < SAME_PORT_MM) {
                    Some(port) => seen[port].push(*fulcrum),
                    None => seen.push(vec![*fulcrum]),
                }
            }
        }
        Self(
            seen.iter()
                .filter(|of_port| of_port.len() >= MIN_SESSIONS)
                .filter_map(|of_port| median_fulcrum(of_port))
                .collect(),
        )
    }

    /// Compares a session's trocars with the ports.
    pub fn compare(&self, tools: &[Option<Fulcrum>]) -> PortPlacement {
        let pairs = self.pairs(tools);
        let known: Vec<(Fulcrum, Fulcrum)> = pairs.iter().copied().flatten().collect();
        let camera = camera_displacement(&known);
        let shift = |pair: Option<(Fulcrum, Fulcrum)>| {
            pair.and_then(|(port, now)| displacement(&port, &now))
                .filter(|shift| camera.is_some() || shift.mm < OTHER_PORT_MM)
        };
        PortPlacement { camera, tools: pairs.into_iter().map(shift).collect() }
    }

    /// What a session's trocars say about the box as a whole.
    pub fn agreement(&self, tools: &[Option<Fulcrum>]) -> PortAgreement {
        let known: Vec<(Fulcrum, Fulcrum)> = self.pairs(tools).into_iter().flatten().collect();
        let shifts: Option<Vec<Displacement>> = known.iter().map(|(port, now)| displacement(port, now)).collect();
        let Some(shifts) = shifts.filter(|shifts| shifts.len() > 1) else { return PortAgreement::Unknown };
        if let Some(camera) = camera_displacement(&known) {
            return PortAgreement::Moved(camera);
        }
        if shifts.iter().all(|shift| !shift.has_moved()) {
            return PortAgreement::InPlace;
        }
        let smallest = shifts.into_iter().min_by(|a, b| a.mm.total_cmp(&b.mm));
        smallest.filter(Displacement::has_moved).map_or(PortAgreement::Unknown, PortAgreement::Rearranged)
    }

    /// For each tool its port and its trocar, if both are known.
    fn pairs(&self, tools: &[Option<Fulcrum>]) -> Vec<Option<(Fulcrum, Fulcrum)>> {
        let at: Vec<Option<Point3<f64>>> = tools.iter().map(|tool| tool.map(|fulcrum| fulcrum.at)).collect();
        let ports = assign_ports(&at, &self.0.iter().map(|port| port.at).collect::<Vec<_>>());
        tools.iter().zip(ports).map(|(tool, port)| Some((self.0[port?], (*tool)?))).collect()
    }
}

/// The displacement of the camera, if every trocar agrees: all have moved, and their mutual distances are unchanged.
fn camera_displacement(pairs: &[(Fulcrum, Fulcrum)]) -> Option<Displacement> {
    let shifts: Vec<Displacement> = pairs.iter().map(|(port, now)| displacement(port, now)).collect::<Option<_>>()?;
    let largest = shifts.iter().copied().max_by(|a, b| a.mm.total_cmp(&b.mm)).filter(Displacement::has_moved)?;
    // A camera that has turned leaves one trocar nearer to its old position than another, but none in place.
    let are_all = shifts.iter().all(|shift| shift.is_significant() && shift.mm > 0.5 * MAX_DISPLACEMENT_MM);
    let mut two = pairs.iter().enumerate().flat_map(|(i, one)| pairs[i + 1..].iter().map(move |other| (one, other)));
    (pairs.len() > 1 && are_all && two.all(|(one, other)| is_rigid(one, other))).then_some(largest)
}

/// True if two trocars are as far apart as before.
fn is_rigid(one: &(Fulcrum, Fulcrum), other: &(Fulcrum, Fulcrum)) -> bool {
    let apart =
        |a: &Fulcrum, b: &Fulcrum| Fulcrum { at: Point3::from(a.at - b.at), covariance: a.covariance + b.covariance };
    let (before, now) = (apart(&one.0, &other.0), apart(&one.1, &other.1));
    let [was, is] = [&before, &now].map(|apart| apart.at.coords.norm());
    let sigma = |apart: &Fulcrum| sigma_along(&apart.covariance, &apart.at.coords).unwrap_or(f64::INFINITY);
    (is - was).abs() < (SIGNIFICANT_SIGMAS * sigma(&before).hypot(sigma(&now))).max(0.5 * MAX_DISPLACEMENT_MM)
}

/// `None` if a covariance is not positive.
fn displacement(port: &Fulcrum, now: &Fulcrum) -> Option<Displacement> {
    let shift = now.at - port.at;
    let sigma_mm = sigma_along(&(port.covariance + now.covariance), &shift)?;
    Some(Displacement { mm: shift.norm(), sigma_mm })
}

fn sigma_along(covariance: &Matrix3<f64>, direction: &Vector3<f64>) -> Option<f64> {
    let along = direction.try_normalize(1e-9).unwrap_or(Vector3::x());
    let variance = along.dot(&(covariance * along));
    (variance > 0.0).then(|| variance.sqrt())
}

/// Assigns ports to tools: the nearest pairs first, no port twice.
fn assign_ports(tools: &[Option<Point3<f64>>], ports: &[Point3<f64>]) -> Vec<Option<usize>> {
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

/// The median position, with the remaining error of the sessions.
fn median_fulcrum(fulcrums: &[Fulcrum]) -> Option<Fulcrum> {
    let axis = |axis: usize| quantile(fulcrums.iter().map(|fulcrum| fulcrum.at[axis]).collect(), 0.5);
    let count = fulcrums.len() as f64;
    let mean: Matrix3<f64> = fulcrums.iter().map(|fulcrum| fulcrum.covariance).sum::<Matrix3<f64>>() / count;
    Some(Fulcrum { at: Point3::new(axis(0)?, axis(1)?, axis(2)?), covariance: mean * (MEDIAN_VARIANCE_RATIO / count) })
}

#[cfg(test)]
mod tests;
