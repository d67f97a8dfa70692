use super::*;

const FILE: &str = r#"{"tool_diameter_mm":8.0,"band_length_mm":25,
    "tools":[{"tool":"cyan","diameter_mm":5.0}],
    "labels":[{"frame":1,"label":"orange","x":1,"y":2,"w":3,"h":4},
              {"frame":1,"label":"cyan","x":9,"y":2,"w":3,"h":4},
              {"frame":1,"label":"background","x":5,"y":6,"w":7,"h":8}]}"#;

#[test]
fn a_tools_own_size_wins_and_background_is_no_tool() {
    let tools = AnnotationsFile::parse(FILE).unwrap().marked_tools().unwrap();
    let names: Vec<_> = tools.iter().map(|t| (t.name.as_str(), t.diameter_mm, t.marker)).collect();
    let band = MarkerEntry::Band { length_mm: Some(25.0) };
    assert_eq!(names, [("orange", 8.0, band), ("cyan", 5.0, band)]);
}

/// An annotations file with these entries of `tools` and rectangles of these labels.
fn annotations_with(tools: &str, labels: &[&str]) -> Result<AnnotationsFile, AnnotationsError> {
    let label = |label: &&str| format!(r#"{{"frame":0,"label":"{label}","x":0,"y":0,"w":1,"h":1}}"#);
    let labels: Vec<String> = labels.iter().map(label).collect();
    AnnotationsFile::parse(&format!(r#"{{"tool_diameter_mm":5,"tools":[{tools}],"labels":[{}]}}"#, labels.join(",")))
}

#[test]
fn two_tools_of_one_colour_are_marked_by_its_label_or_by_either_name() {
    let pair = r#"{"tool":"left","colour":"orange"},{"tool":"b","colour":"orange","side":"right"}"#;
    for labels in [&["orange"][..], &["b", "background"], &["left", "b"]] {
        let file = annotations_with(pair, labels).unwrap();
        let tools = file.marked_tools().unwrap();
        let found: Vec<_> = tools.iter().map(|t| (t.name.as_str(), t.colour.as_str(), t.side)).collect();
        assert_eq!(found, [("left", "orange", Some(Side::Left)), ("b", "orange", Some(Side::Right))], "{labels:?}");
        assert_eq!(file.marked_colours(), ["orange"]);
    }
}

#[test]
fn a_marker_of_tape_is_read_and_other_kinds_are_refused_by_name() {
    let with = |head: &str, marker: &str| {
        AnnotationsFile::parse(&format!(
            r#"{{{head} "tool_diameter_mm":5,"tools":[{{"tool":"orange","marker":{marker}}}],
                "labels":[{{"frame":0,"label":"orange","x":0,"y":0,"w":1,"h":1}}]}}"#
        ))
    };
    let band = with(r#""needs":2,"#, r#"{"kind":"band","length_mm":24}"#).unwrap();
    assert_eq!(band.marked_tools().unwrap()[0].marker, MarkerEntry::Band { length_mm: Some(24.0) });
    let written = serde_json::to_string(&band).unwrap();
    assert_eq!(AnnotationsFile::parse(&written).unwrap(), band, "{written}");
    assert_eq!(with(r#""needs":3,"#, r#"{"kind":"band"}"#), Err(AnnotationsError::Newer(3)));
    assert_eq!(AnnotationsFile::parse(r#"{"needs":3,"tools":{},"labels":{}}"#), Err(AnnotationsError::Newer(3)));
    let misspelt = with(r#""needs":2,"#, r#"{"kind":"band","lenght_mm":24}"#);
    assert!(matches!(&misspelt, Err(AnnotationsError::Syntax(text)) if text.contains("lenght_mm")), "{misspelt:?}");
    let negative = with(r#""needs":2,"#, r#"{"kind":"band","length_mm":-1}"#).unwrap_err().to_string();
    assert!(negative.contains("marker.length_mm"), "{negative}");
    let rings = AnnotationsError::UnknownMarker { tool: "orange".into(), kind: "rings".into() };
    assert_eq!(with(r#""needs":2,"#, r#"{"kind":"rings","rims_mm":[0,6]}"#), Err(rings));
    let by_hue = with(r#""needs":2,"segmentation":{"kind":"hsv"},"#, r#"{"kind":"band"}"#);
    assert_eq!(by_hue, Err(AnnotationsError::UnknownSegmentation("hsv".into())));
    let two_lengths = annotations_with(
        r#"{"tool":"orange","band_length_mm":25,"marker":{"kind":"band","length_mm":24}}"#,
        &["orange"],
    );
    assert_eq!(two_lengths, Err(AnnotationsError::TwoLengths("orange".into())));
}

#[test]
fn a_tool_of_its_colours_name_may_share_it() {
    let tools =
        annotations_with(r#"{"tool":"orange"},{"tool":"second","colour":"orange"}"#, &["orange", "cyan"]).unwrap();
    let names: Vec<String> = tools.marked_tools().unwrap().into_iter().map(|t| t.name).collect();
    assert_eq!(names, ["orange", "second", "cyan"]);
}

#[test]
fn an_invalid_or_ambiguous_colour_is_refused() {
    let refused = |tools: &str| annotations_with(tools, &["orange"]).unwrap_err();
    let of = |colour: &str| AnnotationsError::InvalidColour { tool: "a".into(), colour: colour.into() };
    assert_eq!(refused(r#"{"tool":"a","colour":"background"}"#), of("background"));
    assert_eq!(refused(r#"{"tool":"a","colour":" "}"#), of(" "));
    let twice = r#"{"tool":"a","colour":"orange"},{"tool":"a","colour":"cyan"}"#;
    assert_eq!(refused(twice), AnnotationsError::TwoColours("a".into()));
}

#[test]
fn a_tool_cannot_have_a_reserved_label_as_its_name() {
    let refused = annotations_with(r#"{"tool":"background","colour":"orange"}"#, &["orange", "background"]);
    assert_eq!(refused, Err(AnnotationsError::ReservedName("background".into())));
    assert!(
        annotations_with(r#"{"tool":"jaw","diameter_mm":4}"#, &["orange", "jaw"]).is_ok(),
        "a size without a colour does no harm"
    );
}

#[test]
fn a_tool_name_cannot_be_a_spreadsheet_formula() {
    for name in ["=1+1", "+cyan", "-cyan", "@cyan", " cyan", "", "two\\nlines", &"c".repeat(65)] {
        let listed = format!(r#"{{"tool":"{name}","colour":"cyan"}}"#);
        for file in [annotations_with(&listed, &["cyan"]), annotations_with("", &[name])] {
            let refused = file.and_then(|file| file.marked_tools()).unwrap_err();
            assert!(matches!(refused, AnnotationsError::InvalidName(_)), "{name:?}: {refused}");
        }
    }
    for name in ["left", "2nd", "Änne", &"c".repeat(64)] {
        assert!(annotations_with("", &[name]).unwrap().marked_tools().is_ok(), "{name:?}");
    }
}

#[test]
fn at_most_the_maximum_number_of_colours_is_accepted() {
    let colours: Vec<String> = (0..=MAX_COLOURS).map(|i| format!("colour {i}")).collect();
    let labels: Vec<&str> = colours.iter().map(String::as_str).collect();
    assert!(annotations_with("", &labels[1..]).is_ok());
    assert_eq!(annotations_with("", &labels), Err(AnnotationsError::TooManyColours(MAX_COLOURS + 1)));
}

#[test]
fn a_side_is_read_from_a_whole_word_of_a_name() {
    let side = |name| Side::from_name(name);
    assert_eq!(["Left", "grasper-left", "left hand"].map(side), [Some(Side::Left); 3]);
    assert_eq!(side("right_scissors"), Some(Side::Right));
    assert_eq!(["orange", "cleft", "left or right"].map(side), [None; 3]);
}

#[test]
fn a_rectangle_that_leaves_the_frame_is_named() {
    let file = AnnotationsFile::parse(FILE).unwrap();
    assert_eq!(file.check_inside(12, 14), Ok(()));
    assert!(matches!(file.check_inside(11, 14), Err(AnnotationsError::OutsideFrame { index: 1, .. })));
}

#[test]
fn only_background_is_not_enough() {
    let text = r#"{"tool_diameter_mm":8,"labels":[{"frame":0,"label":"jaw","x":0,"y":0,"w":1,"h":1}]}"#;
    assert_eq!(AnnotationsFile::parse(text), Err(AnnotationsError::NoTool));
}

/// An annotations file of version 2 with these entries of `tools` and rectangles of these labels.
fn bare_tools(tools: &str, labels: &[&str]) -> Result<AnnotationsFile, AnnotationsError> {
    let label = |label: &&str| format!(r#"{{"frame":0,"label":"{label}","x":0,"y":0,"w":1,"h":1}}"#);
    let labels: Vec<String> = labels.iter().map(label).collect();
    AnnotationsFile::parse(&format!(
        r#"{{"needs":2,"tool_diameter_mm":5,"band_length_mm":25,"empty_box":"empty.jpg",
            "tools":[{tools}],"labels":[{}]}}"#,
        labels.join(",")
    ))
}

/// The entry of a tool without tape; `keys` follow its name.
fn bare(name: &str, keys: &str) -> String {
    format!(r#"{{"tool":"{name}",{keys}"marker":{{"kind":"shaft"}}}}"#)
}

#[test]
fn two_bare_tools_share_the_label_of_shafts_and_a_tape_keeps_its_own() {
    let right = r#"{"tool":"second","side":"right","diameter_mm":10,
        "marker":{"kind":"shaft","collar_mm":8.0,"jaw_mm":28.3}}"#;
    let tools = format!("{},{right}", bare("left", ""));
    for labels in [&["orange", "shaft", "background"][..], &["orange", "left"], &["orange", "second", "jaw"]] {
        let file = bare_tools(&tools, labels).unwrap();
        let found = file.marked_tools().unwrap();
        let found: Vec<_> =
            found.iter().map(|t| (t.name.as_str(), t.colour.as_str(), t.side, t.diameter_mm, t.marker)).collect();
        let shaft = |collar_mm, jaw_mm| MarkerEntry::Shaft { collar_mm, jaw_mm };
        assert_eq!(
            found,
            [
                ("orange", "orange", None, 5.0, MarkerEntry::Band { length_mm: Some(25.0) }),
                ("left", "shaft", Some(Side::Left), 5.0, shaft(None, None)),
                ("second", "shaft", Some(Side::Right), 10.0, shaft(Some(8.0), Some(28.3))),
            ],
            "{labels:?}"
        );
        assert_eq!(file.tape_colours(), ["orange"], "the check of tapes leaves shafts out");
        assert_eq!(file.empty_box.as_deref(), Some("empty.jpg"));
        let written = serde_json::to_string(&file).unwrap();
        assert_eq!(AnnotationsFile::parse(&written).unwrap(), file, "{written}");
    }
    let black = bare_tools(&bare("left", r#""colour":"black","#), &["black", "shaft"]).unwrap();
    assert_eq!(black.marked_colours(), ["black"], "shafts are no tool where no tool has their label");
}

#[test]
fn a_bare_tool_becomes_a_shaft_of_the_tracker_with_its_sizes() {
    let tool = r#"{"tool":"left","marker":{"kind":"shaft","collar_mm":8.0,"jaw_mm":28.3}}"#;
    let [tool] = &bare_tools(tool, &["shaft"]).unwrap().marked_tools().unwrap()[..] else { panic!("one tool") };
    let spec = ToolSpec::from(tool.clone());
    assert_eq!(spec.marker, Marker::Shaft { collar_mm: Some(8.0), jaw_mm: Some(28.3) });
    assert_eq!((spec.colour.as_str(), spec.side, spec.diameter_mm), ("shaft", Some(HandSide::Left), 5.0));
}

#[test]
fn files_of_rendered_bare_tools_are_read() {
    let Some(worlds) = crate::resources::shared("worlds/dev") else { return };
    for (world, names) in [("bare28", &["left"][..]), ("bare32", &["left", "right"])] {
        let path = worlds.join(world).join("contract/annotations_marker.json");
        let tools = AnnotationsFile::parse(&std::fs::read_to_string(path).unwrap()).unwrap().marked_tools().unwrap();
        let found: Vec<&str> = tools.iter().map(|tool| tool.name.as_str()).collect();
        assert_eq!(found, names, "{world}");
        assert!(tools.iter().all(|tool| tool.marker.is_shaft() && tool.colour == "shaft"), "{world}: {tools:?}");
    }
}

#[test]
fn a_bare_tool_needs_version_2_a_rectangle_and_a_side_of_its_own() {
    let refused = |tools: &str, labels: &[&str]| bare_tools(tools, labels).unwrap_err();
    let entry = bare("left", "");
    let of_version_1 = annotations_with(&entry, &["shaft"]);
    assert_eq!(of_version_1, Err(AnnotationsError::ShaftWithoutNeeds("left".into())));
    let not_marked = AnnotationsError::ShaftNotMarked { tool: "left".into(), colour: "shaft".into() };
    assert_eq!(refused(&entry, &["background"]), not_marked);
    assert_eq!(refused(&entry, &["orange", "background"]), not_marked);
    let sideless = refused(&bare("grasper", ""), &["shaft"]);
    assert_eq!(sideless, AnnotationsError::ShaftWithoutSide("grasper".into()));
    assert!(sideless.to_string().contains(r#"add `"side": "left"`"#), "{sideless}");
    let twice = format!("{},{}", bare("left", ""), bare("grasper", r#""side":"left","#));
    assert_eq!(refused(&twice, &["shaft"]), AnnotationsError::ShaftsOnOneSide(["left".into(), "grasper".into()]));
    let other_colour = format!("{},{}", bare("left", ""), bare("grasper", r#""side":"left","colour":"steel","#));
    assert!(matches!(refused(&other_colour, &["shaft", "steel"]), AnnotationsError::ShaftsOnOneSide(_)));
    let three = format!("{},{},{}", bare("left", ""), bare("right", ""), bare("third", r#""side":"left","#));
    assert!(matches!(refused(&three, &["shaft"]), AnnotationsError::ShaftsOnOneSide(_)));
}

#[test]
fn a_bare_tool_with_the_size_or_colour_of_a_tape_is_refused() {
    let refused = |tools: &str| bare_tools(tools, &["shaft", "orange"]).unwrap_err();
    let band = refused(&bare("left", r#""band_length_mm":25,"#));
    assert_eq!(band, AnnotationsError::BandOfShaft("left".into()));
    let orange = bare("left", r#""colour":"orange","#);
    let both = AnnotationsError::TapeAndShaft { tool: "left".into(), colour: "orange".into() };
    assert_eq!(refused(&format!(r#"{orange},{{"tool":"orange","side":"right"}}"#)), both);
    assert_eq!(refused(&format!(r#"{},{{"tool":"shaft"}}"#, bare("left", ""))), {
        AnnotationsError::TapeAndShaft { tool: "left".into(), colour: "shaft".into() }
    });
    assert_eq!(refused(&bare("shaft", r#""side":"left","#)), AnnotationsError::ReservedName("shaft".into()));
    assert!(matches!(refused(&bare("left", r#""colour":"jaw","#)), AnnotationsError::InvalidColour { .. }));
    for size in [r#""collar_mm":0"#, r#""jaw_mm":-1"#, r#""jaw_mm":100.1"#] {
        let tool = format!(r#"{{"tool":"left","marker":{{"kind":"shaft",{size}}}}}"#);
        let key = size.split('"').nth(1).unwrap();
        let text = refused(&tool).to_string();
        assert!(text.contains(&format!("marker.{key}")), "{text}");
    }
    let unknown = refused(r#"{"tool":"left","marker":{"kind":"shaft","length_mm":25}}"#);
    assert!(matches!(&unknown, AnnotationsError::Syntax(text) if text.contains("length_mm")), "{unknown:?}");
    let no_size = r#"{"needs":2,"tools":[{"tool":"left","marker":{"kind":"shaft"}}],
        "labels":[{"frame":0,"label":"shaft","x":0,"y":0,"w":1,"h":1}]}"#;
    assert_eq!(AnnotationsFile::parse(no_size), Err(AnnotationsError::NoDiameter("left".into())));
}

#[test]
fn shafts_without_a_bare_tool_are_no_tool() {
    let file = bare_tools(r#"{"tool":"orange"}"#, &["orange", "shaft"]).unwrap();
    assert_eq!((file.marked_colours(), file.tape_colours()), (vec!["orange"], vec!["orange".to_owned()]));
    assert_eq!(bare_tools("", &["shaft"]), Err(AnnotationsError::NoTool));
}
