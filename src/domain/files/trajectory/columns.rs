//! Trajectory → one vector per column: pages plot it, and the Parquet writer uses it.

use serde::Serialize;

use super::{ThinnedTrajectory, state_name};
use crate::vision::trajectory::{Sample, Trajectory};

/// A trajectory, column by column. Serialises as `{"tools":[…],"columns":{"frame":[…],…,"state":[…]}}`, where the
/// column `tool` holds indices into `tools` and an absent number is `null`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrajectoryColumns {
    /// Names of the tools.
    pub tools: Vec<String>,
    /// The columns, all of one length.
    pub columns: SampleColumns,
}

/// The columns under their names in the table.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[allow(missing_docs)] // the names are those of the table and document themselves
pub struct SampleColumns {
    pub frame: Vec<u64>,
    pub time_s: Vec<f64>,
    pub tool: Vec<usize>,
    pub x_mm: Vec<f64>,
    pub y_mm: Vec<f64>,
    pub z_mm: Vec<f64>,
    pub vx_mm_s: Vec<Option<f64>>,
    pub vy_mm_s: Vec<Option<f64>>,
    pub vz_mm_s: Vec<Option<f64>>,
    pub axis_x: Vec<Option<f64>>,
    pub axis_y: Vec<Option<f64>>,
    pub axis_z: Vec<Option<f64>>,
    pub tip_u_px: Vec<Option<f64>>,
    pub tip_v_px: Vec<Option<f64>>,
    pub sigma_xy_mm: Vec<Option<f64>>,
    pub sigma_z_mm: Vec<Option<f64>>,
    pub state: Vec<&'static str>,
    pub cov_xx_mm2: Vec<Option<f64>>,
    pub cov_xy_mm2: Vec<Option<f64>>,
    pub cov_xz_mm2: Vec<Option<f64>>,
    pub cov_yy_mm2: Vec<Option<f64>>,
    pub cov_yz_mm2: Vec<Option<f64>>,
    pub cov_zz_mm2: Vec<Option<f64>>,
}

impl From<&Trajectory> for TrajectoryColumns {
    fn from(trajectory: &Trajectory) -> Self {
        let mut columns = SampleColumns::default();
        trajectory.samples.iter().for_each(|sample| columns.push(sample));
        Self { tools: trajectory.tools.clone(), columns }
    }
}

impl SampleColumns {
    fn push(&mut self, sample: &Sample) {
        self.frame.push(sample.frame);
        self.time_s.push(sample.time_s);
        self.tool.push(sample.tool);
        self.x_mm.push(sample.tip_mm.x);
        self.y_mm.push(sample.tip_mm.y);
        self.z_mm.push(sample.tip_mm.z);
        self.vx_mm_s.push(sample.velocity_mm_s.map(|v| v.x));
        self.vy_mm_s.push(sample.velocity_mm_s.map(|v| v.y));
        self.vz_mm_s.push(sample.velocity_mm_s.map(|v| v.z));
        self.axis_x.push(sample.axis.map(|a| a.x));
        self.axis_y.push(sample.axis.map(|a| a.y));
        self.axis_z.push(sample.axis.map(|a| a.z));
        self.tip_u_px.push(sample.tip_px.map(|p| p.x));
        self.tip_v_px.push(sample.tip_px.map(|p| p.y));
        self.sigma_xy_mm.push(sample.sigma_xy_mm());
        self.sigma_z_mm.push(sample.sigma_z_mm());
        self.state.push(state_name(sample.state));
        self.cov_xx_mm2.push(sample.covariance_mm2.map(|of| of.xx));
        self.cov_xy_mm2.push(sample.covariance_mm2.map(|of| of.xy));
        self.cov_xz_mm2.push(sample.covariance_mm2.map(|of| of.xz));
        self.cov_yy_mm2.push(sample.covariance_mm2.map(|of| of.yy));
        self.cov_yz_mm2.push(sample.covariance_mm2.map(|of| of.yz));
        self.cov_zz_mm2.push(sample.covariance_mm2.map(|of| of.zz));
    }
}

/// The trajectory as JSON columns.
pub fn to_json_columns(trajectory: &Trajectory) -> String {
    // Vectors of numbers and strings always serialise; a number that is not finite becomes null.
    serde_json::to_string(&TrajectoryColumns::from(trajectory)).unwrap_or_default()
}

/// A thinned trajectory as JSON columns, with `after_gap` for each row and `thinned`: whether any rows were removed.
pub fn thinned_to_json(left: &ThinnedTrajectory) -> String {
    #[derive(Serialize)]
    struct ThinnedDocument<'a> {
        #[serde(flatten)]
        table: TrajectoryColumns,
        after_gap: &'a [bool],
        thinned: bool,
    }
    let ThinnedTrajectory { trajectory, after_gap, is_thinned } = left;
    serde_json::to_string(&ThinnedDocument { table: trajectory.into(), after_gap, thinned: *is_thinned })
        .unwrap_or_default()
}
