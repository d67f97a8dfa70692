//! `trocar model` and `trocar score --model`: a model is made from declared levels, used, and refused where it does not
//! apply.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn trocar(folder: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trocar")).args(line.split(' ')).current_dir(folder).output().unwrap()
}

/// Runs a command that must refuse its input, and returns its line on stderr.
fn refusal(folder: &Path, line: &str) -> String {
    let output = trocar(folder, line);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{line}: {stderr}");
    assert!(stderr.trim_end().lines().count() == 1 && output.stdout.is_empty(), "{line}: {stderr}");
    stderr
}

/// A trajectory of a tool that moves to and fro for `seconds`, with stated errors.
fn path(seconds: f64) -> String {
    let mut csv = "frame,time_s,tool,x_mm,y_mm,z_mm,vx_mm_s,vy_mm_s,vz_mm_s,axis_x,axis_y,axis_z,tip_u_px,tip_v_px,\
                   sigma_xy_mm,sigma_z_mm,state\n"
        .to_owned();
    for frame in 0..(seconds * 25.0) as usize {
        let time = frame as f64 / 25.0;
        let (x, y, z) = (20.0 * (2.0 * time).sin(), 10.0 * (3.1 * time).sin(), 150.0 + 8.0 * (1.3 * time).cos());
        writeln!(csv, "{frame},{time},orange,{x},{y},{z},,,,0,0,1,,,0.01,0.04,observed").unwrap();
    }
    csv
}

/// Writes the features of 24 people with two sessions each, from `trocar score --json`, and the people's labels.
fn write_features_and_labels(folder: &Path) {
    let mut labels = "file,person,level\n".to_owned();
    let mut tracks = Vec::new();
    for session in 0..48 {
        let (person, level) = (session / 2, session / 2 % 3);
        let seconds = 12.0 + 8.0 * level as f64 + 0.13 * ((session * 29) % 17) as f64;
        let file = format!("{session}.csv");
        fs::write(folder.join(&file), path(seconds)).unwrap();
        writeln!(labels, "{file},p{person},{}", ["expert", "intermediate", "novice"][level]).unwrap();
        tracks.push(file);
    }
    let scored = trocar(folder, &format!("score --json {}", tracks.join(" ")));
    assert!(scored.status.success(), "{scored:?}");
    fs::write(folder.join("features.json"), scored.stdout).unwrap();
    fs::write(folder.join("labels.csv"), labels).unwrap();
}

const MAKE: &str = "model --quiet --task pegs --labels labels.csv --out model.json features.json";

#[test]
fn declared_levels_become_a_model_that_states_its_accuracy() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_features_and_labels(folder);
    let made = trocar(folder, MAKE);
    let report = String::from_utf8(made.stdout).unwrap();
    assert!(
        made.status.success() && report.contains("24 people and 48 sessions") && report.contains("it knows something"),
        "{report}"
    );
    let first = fs::read(folder.join("model.json")).unwrap();
    assert!(trocar(folder, MAKE).status.success());
    assert_eq!(fs::read(folder.join("model.json")).unwrap(), first, "the same data give the same bytes");

    fs::write(folder.join("new.csv"), path(12.9)).unwrap();
    let scored = trocar(folder, "score --json --task pegs --model model.json new.csv");
    let skill = serde_json::from_slice::<Value>(&scored.stdout).unwrap()[0]["skill"].clone();
    assert_eq!(skill["level"], "expert", "{skill}");
    assert!(skill["accuracy"]["low"].as_f64() > Some(0.4) && skill["carried"][0]["raises"].is_number(), "{skill}");
    let text = String::from_utf8(trocar(folder, "score --model model.json new.csv").stdout).unwrap();
    assert!(
        text.contains("skill: expert (novice") && text.contains("where such models gave this level, it was right"),
        "{text}"
    );

    // No level without stated errors, nor for a session unlike all sessions of the model.
    let bare: String =
        path(12.9).lines().map(|line| line.split(',').take(6).collect::<Vec<_>>().join(",") + "\n").collect();
    fs::write(folder.join("bare.csv"), bare).unwrap();
    fs::write(folder.join("long.csv"), path(200.0)).unwrap();
    for (file, why) in [("bare.csv", "error_unknown"), ("long.csv", "outside")] {
        let scored = trocar(folder, &format!("score --json --model model.json {file}"));
        let skill = serde_json::from_slice::<Value>(&scored.stdout).unwrap()[0]["skill"].clone();
        assert_eq!((&skill["level"], &skill["reason"]["name"]), (&Value::Null, &json!(why)), "{skill}");
    }
    assert!(refusal(folder, "score --task other --model model.json new.csv").contains("is of the task pegs"));
    fs::write(folder.join("broken.json"), &first[..first.len() / 2]).unwrap();
    assert!(refusal(folder, "score --model broken.json new.csv").contains("broken.json"));

    // Each refusal of labels says what to do.
    let labels = fs::read_to_string(folder.join("labels.csv")).unwrap();
    for (changed, why) in [
        (labels.replace("\n7.csv,p3,expert", ""), "7.csv has no label"),
        (labels.clone() + "99.csv,p0,expert\n", "99.csv has a label and no features"),
        (labels.clone() + "7.csv,p3,expert\n", "has two rows"),
        (labels.replace("7.csv,p3,expert", "7.csv,p3,wizard"), "wizard"),
        (labels.replace("7.csv,p3,expert", "7.csv,p3,novice"), "two levels"),
        (labels.replace(",expert", ",novice"), "expert: 0, 8 missing"),
    ] {
        fs::write(folder.join("labels.csv"), changed).unwrap();
        assert!(refusal(folder, MAKE).contains(why), "{why}: {}", refusal(folder, MAKE));
    }
}
