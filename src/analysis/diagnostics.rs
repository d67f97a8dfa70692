//! What the tracker saw on every frame, as JSON that the pages draw over the video: in columns, to keep an hour's file
//! small. [`stored_rows`](super::stored_rows) reads single frames of it.

use serde::Serialize;

use super::protocol::SeenRow;
use crate::vision::reason::MissReason;

/// The JSON document.
#[derive(Debug, Serialize)]
pub struct Diagnostics<'a> {
    width: u32,
    height: u32,
    tools: &'a [String],
    columns: DiagnosticsColumns,
}

#[derive(Debug, Default, Serialize)]
struct DiagnosticsColumns {
    frame: Vec<u64>,
    tool: Vec<u32>,
    reason: Vec<Option<&'static str>>,
    border_a: Vec<Option<[f32; 4]>>,
    border_b: Vec<Option<[f32; 4]>>,
    tip_u_px: Vec<Option<f32>>,
    tip_v_px: Vec<Option<f32>>,
}

impl<'a> Diagnostics<'a> {
    /// Diagnostics for frames of this size: borders as `u1 v1 u2 v2`, tips as `u v`, in pixels of the recorded frame.
    pub fn new((width, height): (u32, u32), tools: &'a [String], rows: &[SeenRow]) -> Self {
        let mut columns = DiagnosticsColumns::default();
        for row in rows {
            columns.frame.push(row.frame);
            columns.tool.push(row.tool);
            columns.reason.push(row.reason.map(MissReason::name));
            columns.border_a.push(row.borders_px.map(|[a, _]| a));
            columns.border_b.push(row.borders_px.map(|[_, b]| b));
            columns.tip_u_px.push(row.tip_px.map(|[u, _]| u));
            columns.tip_v_px.push(row.tip_px.map(|[_, v]| v));
        }
        Self { width, height, tools, columns }
    }

    /// The document as JSON text.
    pub fn to_json(&self) -> serde_json::Result<Vec<u8>> {
        serde_json::to_vec(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_a_place_in_every_column() {
        let seen = SeenRow {
            frame: 3,
            tool: 0,
            reason: None,
            borders_px: Some([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.5]]),
            tip_px: Some([9.0, 10.25]),
        };
        let unseen = SeenRow { reason: Some(MissReason::TipHidden), borders_px: None, tip_px: None, frame: 4, tool: 0 };
        let tools = ["orange".to_owned()];
        let text = Diagnostics::new((640, 480), &tools, &[seen, unseen]).to_json().unwrap();
        let expected = [
            r#"{"width":640,"height":480,"tools":["orange"],"columns":{"frame":[3,4],"tool":[0,0],"#,
            r#""reason":[null,"tip_hidden"],"border_a":[[1.0,2.0,3.0,4.0],null],"border_b":[[5.0,6.0,7.0,8.5],null],"#,
            r#""tip_u_px":[9.0,null],"tip_v_px":[10.25,null]}}"#,
        ]
        .concat();
        assert_eq!(String::from_utf8(text).unwrap(), expected);
    }
}
