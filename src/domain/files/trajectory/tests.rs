//! Every format of the table: writing, reading back, and refusing bad tables.

use nalgebra::{Matrix3, Point2, Point3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Sample, Trajectory};

fn csv_of(trajectory: &Trajectory) -> String {
    let mut bytes = Vec::new();
    write_csv(trajectory, &mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

/// The bytes of all pieces.
fn joined(pieces: impl Iterator<Item = std::io::Result<Vec<u8>>>) -> Vec<u8> {
    pieces.map(Result::unwrap).collect::<Vec<_>>().concat()
}

fn rows(trajectory: &Trajectory) -> BoxedRows {
    Box::new(HeldRows::new(trajectory.tools.clone(), trajectory.samples.clone()))
}

fn read(text: &str) -> Result<Trajectory, TrajectoryProblem> {
    read_csv(text.as_bytes())
}

const SHORT: &str = "frame,time_s,tool,x_mm,y_mm,z_mm\n";

fn with_rows(rows: &str) -> String {
    format!("{SHORT}{rows}")
}

fn sample(frame: u64, tool: usize) -> Sample {
    Sample {
        frame,
        time_s: frame as f64 * 0.04,
        tool,
        tip_mm: Point3::new(1.5, -2.25, 180.0),
        velocity_mm_s: Some(Vector3::new(0.0, 10.0, -3.5)),
        axis: Some(Vector3::new(0.0, 0.6, 0.8)),
        tip_px: Some(Point2::new(640.5, 360.25)),
        covariance_mm2: None,
        state: SampleState::Predicted,
    }
}

fn two_tools() -> Trajectory {
    let tools = vec!["orange".to_owned(), "cyan, left".to_owned()];
    let covariance_mm2 = Some(PositionCovariance::from_upper([0.34, 0.0, 0.5, 0.16, -0.25, 4.0]));
    Trajectory {
        tools,
        samples: vec![sample(0, 0), Sample { covariance_mm2, ..sample(0, 1) }, sample(3, 0)],
        frame_times_s: Vec::new(),
        cuts: Vec::new(),
    }
}

#[test]
fn the_header_and_a_row_have_the_documented_form() {
    let text = csv_of(&two_tools());
    let mut lines = text.split('\n');
    assert_eq!(
        lines.next().unwrap(),
        "frame,time_s,tool,x_mm,y_mm,z_mm,vx_mm_s,vy_mm_s,vz_mm_s,axis_x,axis_y,axis_z,tip_u_px,tip_v_px,\
         sigma_xy_mm,sigma_z_mm,state,cov_xx_mm2,cov_xy_mm2,cov_xz_mm2,cov_yy_mm2,cov_yz_mm2,cov_zz_mm2"
    );
    assert_eq!(lines.next().unwrap(), "0,0,orange,1.5,-2.25,180,0,10,-3.5,0,0.6,0.8,640.5,360.25,,,predicted,,,,,,");
    assert!(lines.next().unwrap().ends_with(",0.5,2,predicted,0.34,0,0.5,0.16,-0.25,4"));
    assert!(text.ends_with('\n') && !text.contains('\r'));
}

#[test]
fn a_number_that_is_not_finite_is_not_written() {
    let mut bad = two_tools();
    bad.samples[1].tip_mm.z = f64::NAN;
    let error = write_csv(&bad, Vec::new()).unwrap_err();
    assert_eq!(error.to_string(), "frame 0, tool 1: `z_mm` is not a usable value");
}

#[test]
fn six_columns_in_any_order_are_enough_and_foreign_ones_are_ignored() {
    let text = "\u{feff}tool,confidence,z_mm,y_mm,x_mm,time_s,frame\r\na,0.9,3,2,1,0.5,7\r\n";
    let read = read(text).unwrap();
    assert_eq!(read.tools, ["a"]);
    assert_eq!(read.samples[0].tip_mm, Point3::new(1.0, 2.0, 3.0));
    assert_eq!((read.samples[0].frame, read.samples[0].state), (7, SampleState::Observed));
    assert_eq!(read.samples[0].velocity_mm_s, None);
}

#[test]
fn rows_in_tool_order_come_out_in_frame_order() {
    let read = read(&with_rows("0,0,a,1,1,1\n1,0.04,a,1,1,1\n0,0,b,2,2,2\n1,0.04,b,2,2,2\n")).unwrap();
    let order: Vec<_> = read.samples.iter().map(|s| (s.frame, s.tool)).collect();
    assert_eq!(order, [(0, 0), (0, 1), (1, 0), (1, 1)]);
}

#[test]
fn a_header_alone_is_an_empty_trajectory() {
    assert_eq!(read(SHORT).unwrap().samples, []);
}

#[test]
fn an_empty_file_says_which_columns_it_should_have() {
    assert_eq!(read(""), Err(TrajectoryProblem::Empty));
    assert!(TrajectoryProblem::Empty.to_string().contains("frame,time_s,tool,x_mm,y_mm,z_mm"));
}

#[test]
fn missing_and_repeated_columns_are_named() {
    assert_eq!(read("frame,time_s,tool,x_mm,y_mm\n"), Err(TrajectoryProblem::MissingColumn("z_mm")));
    assert_eq!(read("frame;time_s;tool;x_mm;y_mm;z_mm\n"), Err(TrajectoryProblem::MissingColumn("frame")));
    assert_eq!(read("frame,frame,time_s,tool,x_mm,y_mm,z_mm\n"), Err(TrajectoryProblem::RepeatedColumn("frame")));
}

#[test]
fn an_invalid_field_is_named_with_its_line() {
    for bad in ["NaN", "nan", "inf", "-inf", "", "12,5", "x", "1e300"] {
        let rows = format!("0,0,a,1,1,1\n1,0.04,a,1,\"{bad}\",1\n");
        match read(&with_rows(&rows)) {
            Err(TrajectoryProblem::Field { line: 3, column: "y_mm", text, .. }) => assert_eq!(text, bad),
            other => panic!("{bad}: {other:?}"),
        }
    }
    assert!(matches!(read(&with_rows("-1,0,a,1,1,1\n")), Err(TrajectoryProblem::Field { column: "frame", .. })));
    assert!(matches!(read(&with_rows("0,NaN,a,1,1,1\n")), Err(TrajectoryProblem::Field { column: "time_s", .. })));
    assert!(matches!(read(&with_rows("0,0,,1,1,1\n")), Err(TrajectoryProblem::Field { column: "tool", .. })));
    assert!(matches!(read(&with_rows("0,0,a,1,1\n")), Err(TrajectoryProblem::Syntax(_))));
}

#[test]
fn a_message_repeats_no_more_than_a_line_of_the_file() {
    let long = "x".repeat(1 << 20);
    let message = read(&with_rows(&format!("0,0,a,{long},1,1\n"))).unwrap_err().to_string();
    assert!(message.contains("xxx…") && message.len() < 300, "{}", message.len());
}

#[test]
fn one_tool_twice_on_a_frame_is_refused_with_both_lines() {
    let problem = read(&with_rows("5,0.2,a,1,1,1\n6,0.24,a,1,1,1\n5,0.2,a,1,1,1\n")).unwrap_err();
    assert_eq!(problem, TrajectoryProblem::RepeatedRow { line: 4, tool: "a".to_owned(), frame: 5, earlier: 2 });
}

#[test]
fn times_that_contradict_the_frame_numbers_are_refused() {
    assert!(matches!(read(&with_rows("0,1,a,1,1,1\n1,0.5,a,1,1,1\n")), Err(TrajectoryProblem::Time { line: 3, .. })));
    assert!(matches!(read(&with_rows("0,0,a,1,1,1\n0,0.5,b,1,1,1\n")), Err(TrajectoryProblem::Time { line: 3, .. })));
}

#[test]
fn half_a_velocity_is_refused() {
    let text = "frame,time_s,tool,x_mm,y_mm,z_mm,vx_mm_s,vy_mm_s,vz_mm_s\n0,0,a,1,1,1,5,,5\n";
    assert!(matches!(read(text), Err(TrajectoryProblem::IncompleteVector { line: 2, .. })));
}

#[test]
fn a_file_without_covariances_states_independent_errors_of_its_two_sigmas() {
    let text = "frame,time_s,tool,x_mm,y_mm,z_mm,sigma_xy_mm,sigma_z_mm\n0,0,a,1,1,1,0.3,1.7\n1,1,a,1,1,1,0.3,\n";
    let [both, one] = read(text).unwrap().samples[..] else { panic!("two rows") };
    assert_eq!(both.covariance_mm2, Some(PositionCovariance::from_sigmas(0.3, 1.7)));
    assert_eq!((both.sigma_xy_mm(), both.sigma_z_mm()), (Some(0.3), Some(1.7)));
    assert_eq!(one.covariance_mm2, None);
}

#[test]
fn json_columns_have_one_entry_per_row_and_null_for_what_is_absent() {
    let text = joined(JsonPieces::new(rows(&two_tools())).unwrap());
    assert!(
        text.starts_with(br#"{"tools":["orange","cyan, left"],"columns":{"frame":[0,0,3],"time_s":[0.0,0.0,0.12],"#)
    );
    let json: serde_json::Value = serde_json::from_slice(&text).unwrap();
    assert_eq!(json["tools"], serde_json::json!(["orange", "cyan, left"]));
    assert_eq!(json["columns"]["tool"], serde_json::json!([0, 1, 0]));
    assert_eq!(json["columns"]["sigma_z_mm"], serde_json::json!([null, 2.0, null]));
    assert_eq!(json["columns"]["cov_yz_mm2"], serde_json::json!([null, -0.25, null]));
    let lengths: Vec<_> = COLUMNS.iter().map(|c| json["columns"][c].as_array().map(Vec::len)).collect();
    assert_eq!(lengths, [Some(3); COLUMNS.len()]);
}

#[test]
fn parquet_holds_the_same_table() {
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    use ::parquet::record::RowAccessor;

    let bytes = joined(ParquetPieces::new(rows(&two_tools())).unwrap());
    let file = SerializedFileReader::new(bytes::Bytes::from(bytes)).unwrap();
    let schema = file.metadata().file_metadata().schema_descr();
    let names: Vec<_> = schema.columns().iter().map(|c| c.name().to_owned()).collect();
    assert_eq!(names, COLUMNS);
    let rows: Vec<_> = file.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 3);
    assert_eq!((rows[2].get_long(0).unwrap(), rows[1].get_string(2).unwrap().as_str()), (3, "cyan, left"));
    assert_eq!((rows[0].get_double(4).unwrap(), rows[1].get_double(14).unwrap()), (-2.25, 0.5));
    assert_eq!((rows[1].get_double(19).unwrap(), rows[1].get_double(22).unwrap()), (0.5, 4.0));
    assert!(rows[0].get_double(15).is_err() && rows[0].get_double(22).is_err(), "an absent number is null");
    assert_eq!(rows[0].get_string(16).unwrap(), "predicted");
}

#[test]
fn an_empty_trajectory_is_a_valid_parquet_file() {
    let empty = Trajectory { tools: Vec::new(), samples: Vec::new(), frame_times_s: Vec::new(), cuts: Vec::new() };
    let bytes = joined(ParquetPieces::new(rows(&empty)).unwrap());
    assert_eq!((&bytes[..4], &bytes[bytes.len() - 4..]), (&b"PAR1"[..], &b"PAR1"[..]));
}

/// More rows than are held in memory, or fit into a piece or a row group.
fn long_path() -> Trajectory {
    let frames = 2 * MAX_HELD_ROWS as u64 + 100;
    let samples =
        (0..frames).map(|frame| Sample { tip_mm: Point3::new(frame as f64 / 7.0, 0.0, 1.0), ..sample(frame, 0) });
    Trajectory {
        tools: vec!["orange".to_owned()],
        samples: samples.collect(),
        frame_times_s: Vec::new(),
        cuts: Vec::new(),
    }
}

#[test]
fn pieces_of_a_long_table_add_up_to_the_whole_table_in_every_format() {
    use ::parquet::file::reader::{FileReader, SerializedFileReader};

    let path = long_path();
    let pieces: Vec<Vec<u8>> = CsvPieces::new(rows(&path)).map(Result::unwrap).collect();
    assert!(pieces.len() > 10);
    assert_eq!(String::from_utf8(pieces.concat()).unwrap(), csv_of(&path));

    let pieces: Vec<Vec<u8>> = JsonPieces::new(rows(&path)).unwrap().map(Result::unwrap).collect();
    assert!(pieces.iter().all(|piece| piece.len() < 2 * PIECE_BYTES));
    let json: serde_json::Value = serde_json::from_slice(&pieces.concat()).unwrap();
    let x: Vec<f64> = json["columns"]["x_mm"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    assert_eq!(x, path.samples.iter().map(|row| row.tip_mm.x).collect::<Vec<_>>());
    assert_eq!(json["columns"]["cov_zz_mm2"].as_array().map(Vec::len), Some(path.samples.len()));

    let file = bytes::Bytes::from(joined(ParquetPieces::new(rows(&path)).unwrap()));
    let file = SerializedFileReader::new(file).unwrap();
    assert_eq!(file.metadata().file_metadata().num_rows(), path.samples.len() as i64);
}

#[test]
fn thinned_rows_have_their_gaps_in_json() {
    let path = long_path();
    let thinning = Thinning::of(&mut *rows(&path), &[], 900).unwrap();
    let json = joined(JsonPieces::thinned(rows(&path), thinning).unwrap());
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let count = json["columns"]["frame"].as_array().unwrap().len();
    assert!((200..=910).contains(&count) && json["thinned"] == true, "{count}");
    let after_gap = json["after_gap"].as_array().unwrap();
    assert_eq!((after_gap.len(), &after_gap[0], &after_gap[1]), (count, &true.into(), &false.into()));
}

prop_compose! {
    fn any_sample(tool: usize)(
        frame in 0u64..1_000_000,
        position in prop::array::uniform3(-1e4f64..1e4),
        velocity in prop::option::of(prop::array::uniform3(-1e3f64..1e3)),
        pixel in prop::option::of(prop::array::uniform2(-1e4f64..1e4)),
        root in prop::option::of(prop::array::uniform9(-10.0f64..10.0)),
        seen in any::<bool>(),
    ) -> Sample {
        Sample {
            frame,
            time_s: frame as f64 / 29.97,
            tool,
            tip_mm: Point3::from(position),
            velocity_mm_s: velocity.map(Vector3::from),
            axis: velocity.map(|v| Vector3::from(v).normalize()),
            tip_px: pixel.map(Point2::from),
            covariance_mm2: root.map(|parts| Matrix3::from_row_slice(&parts)).map(|r| (r * r.transpose()).into()),
            state: if seen { SampleState::Observed } else { SampleState::Predicted },
        }
    }
}

proptest! {
    #[test]
    fn what_is_written_reads_back_to_the_last_bit(mut samples in prop::collection::vec(any_sample(0), 0..20)) {
        samples.sort_by_key(|s| s.frame);
        samples.dedup_by_key(|s| s.frame);
        let tools = if samples.is_empty() { Vec::new() } else { vec!["a \"b\", c".to_owned()] };
        let trajectory = Trajectory { tools, samples, frame_times_s: Vec::new(), cuts: Vec::new() };
        prop_assert_eq!(read(&csv_of(&trajectory)).unwrap(), trajectory);
    }

    #[test]
    fn no_text_makes_the_reader_panic(text in "\\PC{0,80}", rows in "[0-9a,.\\-\n\"]{0,80}") {
        let _ = read(&text);
        let _ = read(&with_rows(&rows));
    }
}
