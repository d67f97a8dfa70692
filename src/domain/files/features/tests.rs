//! Each format of the table, written in batches and read back by an independent reader.

use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::record::RowAccessor;

use super::*;
use crate::domain::session::{FeatureError, FeatureSpace};
use crate::ids::CalibrationId;

fn whose(session: &str) -> ExportedSession {
    ExportedSession {
        session: session.to_owned(),
        trainee: "ada".to_owned(),
        task: "pegs".to_owned(),
        in_box: "box-1".to_owned(),
        recorded_at: "2026-11-21T20:14:00Z".to_owned(),
        tracker: None,
        verdict: Some("valid".to_owned()),
        versions: Versions {
            pipeline: "8".to_owned(),
            tracked_with: Some("7".to_owned()),
            calibration: Some(CalibrationId::at(1)),
            palette: None,
            model: None,
        },
    }
}

fn feature(tool: Option<&str>, value: Result<f64, &str>) -> FeatureRow {
    FeatureRow {
        name: "path_length".to_owned(),
        title: "Path length".to_owned(),
        unit: "mm".to_owned(),
        tool: tool.map(str::to_owned),
        space: FeatureSpace::Space3d,
        value: value.map_err(str::to_owned),
        error: value
            .ok()
            .map(|value| Ok(FeatureError { sigma: 0.5, low: value - 1.0, high: value + 1.0, as_measured: value })),
    }
}

/// Three rows, written in two batches.
fn written(format: TableFormat) -> Vec<u8> {
    let (first, second) = (whose("a"), whose("b"));
    let mut table = FeatureTable::new(format).unwrap();
    let rows = [ExportRow::new(&first, &feature(Some("le,ft"), Ok(0.1 + 0.2)))];
    let mut bytes = table.write(&rows).unwrap();
    assert!(!bytes.is_empty() || format == TableFormat::Parquet, "what is ready goes at once");
    bytes.extend(table.write(&[]).unwrap());
    let rows = [feature(None, Ok(7.0)), feature(None, Err("too \"few\" seen"))].map(|f| ExportRow::new(&second, &f));
    bytes.extend(table.write(&rows).unwrap());
    bytes.extend(table.finish().unwrap());
    bytes
}

#[test]
fn csv_has_a_header_and_a_line_for_each_row() {
    let bytes = written(TableFormat::Csv);
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    assert_eq!(reader.headers().unwrap().iter().collect::<Vec<_>>(), COLUMNS);
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 3);
    assert_eq!((&rows[0][8], &rows[0][11], &rows[0][17]), ("le,ft", "0.30000000000000004", "7"));
    assert_eq!((&rows[2][8], &rows[2][11], &rows[2][14]), ("", "", "too \"few\" seen"));
}

#[test]
fn no_text_in_csv_begins_like_a_formula() {
    let text = || "=1+1".to_owned();
    let row = ExportRow {
        session: "-1".to_owned(),
        trainee: text(),
        task: text(),
        in_box: text(),
        recorded_at: text(),
        tracker: Some(text()),
        verdict: Some("@x".to_owned()),
        feature: text(),
        tool: Some("\tx".to_owned()),
        space: "3d",
        unit: text(),
        value: Some(-0.5),
        low: Some(-1.5),
        high: None,
        not_enough: Some("-0 % of the moving time".to_owned()),
        no_error: Some("+x".to_owned()),
        pipeline: text(),
        tracked_with: Some(text()),
        calibration: Some(text()),
        palette: Some(text()),
        model: Some("\rx".to_owned()),
        too_uncertain: Some("half_of_range"),
    };
    let written = |format| {
        let mut table = FeatureTable::new(format).unwrap();
        let mut bytes = table.write(std::slice::from_ref(&row)).unwrap();
        bytes.extend(table.finish().unwrap());
        bytes
    };
    let bytes = written(TableFormat::Csv);
    let cells = csv::Reader::from_reader(bytes.as_slice()).into_records().next().unwrap().unwrap();
    for (cell, column) in cells.iter().zip(COLUMNS) {
        match column {
            "space" => assert_eq!(cell, "3d"),
            "value" => assert_eq!(cell, "-0.5"),
            "low" => assert_eq!(cell, "-1.5"),
            "high" => assert_eq!(cell, ""),
            "too_uncertain" => assert_eq!(cell, "half_of_range"),
            _ => assert!(cell.starts_with('\''), "{column}: {cell:?}"),
        }
    }
    let read: serde_json::Value = serde_json::from_slice(&written(TableFormat::Json)).unwrap();
    assert_eq!(read["items"][0]["trainee"], "=1+1", "JSON has the text itself");
}

#[test]
fn json_is_one_object_for_any_number_of_batches() {
    let read: serde_json::Value = serde_json::from_slice(&written(TableFormat::Json)).unwrap();
    let items = read["items"].as_array().unwrap();
    assert_eq!(items.len(), 3);
    let mut names: Vec<&str> = items[0].as_object().unwrap().keys().map(String::as_str).collect();
    let mut expected = COLUMNS.to_vec();
    names.sort_unstable();
    expected.sort_unstable();
    assert_eq!(names, expected);
    assert_eq!((&items[2]["value"], &items[2]["box"]), (&serde_json::Value::Null, &"box-1".into()));
    let empty = FeatureTable::new(TableFormat::Json).unwrap().finish().unwrap();
    assert_eq!(empty, br#"{"items":[]}"#);
}

#[test]
fn parquet_holds_the_columns_in_their_order_and_a_group_for_each_part() {
    let bytes = bytes::Bytes::from(written(TableFormat::Parquet));
    let reader = SerializedFileReader::new(bytes).unwrap();
    assert_eq!(reader.metadata().num_row_groups(), 2);
    let schema = reader.metadata().file_metadata().schema_descr();
    let names: Vec<&str> = schema.columns().iter().map(|column| column.name()).collect();
    assert_eq!(names, COLUMNS);
    let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 3);
    assert_eq!((rows[0].get_string(8).unwrap().as_str(), rows[0].get_double(11).unwrap()), ("le,ft", 0.1 + 0.2));
    assert_eq!((rows[2].get_string(0).unwrap().as_str(), rows[2].get_double(11).is_err()), ("b", true));
}
