//! What the tracker saw on every frame, as JSON that the pages draw over the video: in columns, to keep an hour's file
//! small.

use std::ops::Range;

use serde::{Deserialize, Serialize};

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

/// Selects frames from stored diagnostics and renames tools: `name_at` gives the index under which a tool appears on a
/// frame.
///
/// # Errors
/// The file is not a diagnostics document.
pub fn select_frames(
    json: &[u8],
    frames: Range<u64>,
    name_at: impl Fn(u64, u32) -> u32,
) -> serde_json::Result<Vec<u8>> {
    #[derive(Deserialize, Serialize)]
    struct Stored<'a> {
        width: u32,
        height: u32,
        tools: Vec<String>,
        #[serde(borrow)]
        columns: StoredColumns<'a>,
    }
    #[derive(Deserialize, Serialize)]
    struct StoredColumns<'a> {
        frame: Vec<u64>,
        tool: Vec<u32>,
        #[serde(borrow)]
        reason: Vec<Option<&'a str>>,
        border_a: Vec<Option<[f32; 4]>>,
        border_b: Vec<Option<[f32; 4]>>,
        tip_u_px: Vec<Option<f32>>,
        tip_v_px: Vec<Option<f32>>,
    }
    fn select_rows<T: Copy>(column: &mut Vec<T>, rows: &[usize]) {
        *column = rows.iter().filter_map(|row| column.get(*row).copied()).collect();
    }
    let mut stored: Stored<'_> = serde_json::from_slice(json)?;
    let columns = &mut stored.columns;
    let name = |row: usize| name_at(columns.frame[row], columns.tool[row]);
    let mut rows: Vec<(usize, u64, u32)> =
        (0..columns.frame.len().min(columns.tool.len())).map(|row| (row, columns.frame[row], name(row))).collect();
    rows.retain(|(_, frame, _)| frames.contains(frame));
    rows.sort_by_key(|(_, frame, tool)| (*frame, *tool));
    let order: Vec<usize> = rows.iter().map(|(row, ..)| *row).collect();
    (columns.frame, columns.tool) = rows.iter().map(|(_, frame, tool)| (*frame, *tool)).unzip();
    select_rows(&mut columns.reason, &order);
    select_rows(&mut columns.border_a, &order);
    select_rows(&mut columns.border_b, &order);
    select_rows(&mut columns.tip_u_px, &order);
    select_rows(&mut columns.tip_v_px, &order);
    serde_json::to_vec(&stored)
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

    #[test]
    fn a_part_has_its_frames_alone_and_whole_it_is_the_same_file() {
        let row = |frame: u64, tool: u32| SeenRow {
            frame,
            tool,
            reason: (tool == 1).then_some(MissReason::TooSmall),
            borders_px: (tool == 0).then_some([[0.1, 0.2, 0.3, 0.4]; 2]),
            tip_px: Some([frame as f32 / 3.0, 7.0]),
        };
        let tools = ["orange".to_owned(), "cyan".to_owned()];
        let rows = |frames: Range<u64>| -> Vec<SeenRow> { frames.flat_map(|f| [row(f, 0), row(f, 1)]).collect() };
        let text = |rows: &[SeenRow]| Diagnostics::new((640, 480), &tools, rows).to_json().unwrap();
        let whole = text(&rows(0..20));
        assert_eq!(select_frames(&whole, 0..u64::MAX, |_, tool| tool).unwrap(), whole);
        assert_eq!(select_frames(&whole, 5..9, |_, tool| tool).unwrap(), text(&rows(5..9)));
        let swapped = select_frames(&whole, 5..6, |_, tool| 1 - tool).unwrap();
        assert_eq!(swapped, text(&[SeenRow { tool: 0, ..row(5, 1) }, SeenRow { tool: 1, ..row(5, 0) }]));
        assert!(select_frames(b"[]", 0..1, |_, tool| tool).is_err());
    }
}
