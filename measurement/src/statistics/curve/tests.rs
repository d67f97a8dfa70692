//! Closed forms, chance, simulated trainees and bad input.

use proptest::prelude::*;

use super::*;

fn sessions(count: u32, of: impl FnMut(u32) -> f64) -> Vec<NumberedValue> {
    let mut of = of;
    (1..=count).map(|number| NumberedValue { number, value: of(number) }).collect()
}

fn exact(plateau: f64, distance: f64, tau: f64) -> impl Fn(u32) -> f64 {
    move |number| plateau + distance * (-f64::from(number - 1) / tau).exp()
}

/// Nearly normal: the sum of twelve uniform draws.
fn gauss(chance: &mut Resampler) -> f64 {
    (0..12).map(|_| chance.pick(1_000_001) as f64 / 1e6).sum::<f64>() - 6.0
}

fn curve(sessions: &[NumberedValue], direction: Direction) -> LearningCurve {
    match fit(sessions, direction).unwrap() {
        LearningFit::Curve(curve) => curve,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_curve_without_noise_is_found_exactly() {
    for (plateau, distance, tau, direction) in [
        (50.0, 120.0, 4.0, Direction::Lower),
        (0.8, -0.5, 2.5, Direction::Higher),
        (-6.0, 3.0, 11.0, Direction::Lower),
        (50.0, 120.0, 0.6, Direction::Lower),
    ] {
        let got = curve(&sessions(12, exact(plateau, distance, tau)), direction);
        let near = |fitted: FittedParameter, want: f64| {
            assert!((fitted.value - want).abs() < 1e-6 * want.abs(), "{fitted:?}, not {want}");
            assert!((fitted.interval.low - want).abs() < 1e-4 * want.abs(), "{fitted:?}, not {want}");
        };
        near(got.plateau, plateau);
        near(got.distance, distance);
        near(got.tau_sessions, tau);
        assert!(got.scatter < 1e-6 * distance.abs());
        assert!((got.value_at(1) - plateau - distance).abs() < 1e-5 * distance.abs());
    }
}

#[test]
fn a_forecast_solves_the_curve_for_the_limit() {
    // 50 + 120 exp(−(n − 1)/4) = 60 at n = 1 + 4 ln 12 = 10.94: from session 11 on.
    let got = curve(&sessions(8, exact(50.0, 120.0, 4.0)), Direction::Lower);
    assert_eq!(got.forecast(60.0), Ok(Forecast::Ahead { at: 11, earliest: 11, latest: Some(11) }));
    // 50 + 120 exp(−(n − 1)/4) = 90 at n = 5.39.
    assert_eq!(got.forecast(90.0), Ok(Forecast::Reached { at: 6 }));
    assert_eq!(got.forecast(200.0), Ok(Forecast::Reached { at: 1 }));
    assert_eq!(got.forecast(45.0), Ok(Forecast::NotWithThisCurve { earliest: None }));
    assert_eq!(got.forecast(f64::NAN), Err(NoAnswer::NotFinite));
    let rising = curve(&sessions(8, exact(0.8, -0.5, 4.0)), Direction::Higher);
    assert_eq!(rising.forecast(0.9), Ok(Forecast::NotWithThisCurve { earliest: None }));
    // 0.5 exp(−(n − 1)/4) = 0.05 at n = 1 + 4 ln 10 = 10.21.
    assert_eq!(rising.forecast(0.75), Ok(Forecast::Ahead { at: 11, earliest: 11, latest: Some(11) }));
    let short = curve(&sessions(7, exact(50.0, 120.0, 2.0)), Direction::Lower);
    assert_eq!(short.forecast(60.0), Ok(Forecast::TooFew { found: 7, needed: 8 }));
}

#[test]
fn a_left_out_session_keeps_its_number() {
    let mut with_gap = sessions(14, exact(50.0, 120.0, 4.0));
    with_gap.drain(2..5);
    let got = curve(&with_gap, Direction::Lower);
    assert!((got.tau_sessions.value - 4.0).abs() < 1e-5 && got.sessions == 11 && got.last == 14, "{got:?}");
}

#[test]
fn nothing_is_said_of_sessions_before_the_first_with_a_value() {
    let at = exact(40.0, 20.0, 2.0);
    let late: Vec<NumberedValue> = (41..=52).map(|number| NumberedValue { number, value: at(number - 40) }).collect();
    let got = curve(&late, Direction::Lower);
    assert!((got.distance.value - 20.0).abs() < 1e-4 && (got.value_at(41) - 60.0).abs() < 1e-4, "{got:?}");
    assert_eq!(got.forecast(200.0), Ok(Forecast::Reached { at: 41 }));
    // 40 + 20 exp(−(n − 41)/2) = 45 at n = 43.8.
    assert_eq!(got.forecast(45.0), Ok(Forecast::Reached { at: 44 }));
    assert_eq!((got.first, got.last), (41, 52));
}

#[test]
fn what_does_not_improve_or_does_not_bend_is_no_curve() {
    let of = |values: Vec<NumberedValue>| fit(&values, Direction::Lower).unwrap();
    assert_eq!(of(sessions(10, |_| 7.0)), LearningFit::NoCurve);
    assert_eq!(of(sessions(10, exact(50.0, -30.0, 3.0))), LearningFit::NoCurve, "it gets worse");
    assert_eq!(of(sessions(10, |number| 100.0 - f64::from(number))), LearningFit::StillStraight);
    assert_eq!(
        of(sessions(10, |number| 100.0 - f64::from(number * number))),
        LearningFit::StillStraight,
        "it speeds up"
    );
    let accelerating = |number: u32| 100.0 - f64::from(number).powi(3);
    assert_eq!(of(sessions(10, accelerating)), LearningFit::StillStraight);
}

#[test]
fn noise_alone_looks_like_a_curve_in_one_of_twenty_cases_at_most() {
    let mut chance = Resampler::of([5.0]);
    let mistaken = (0..400).filter(|_| {
        let noise = sessions(15, |_| 60.0 + 8.0 * gauss(&mut chance));
        fit(&noise, Direction::Lower).unwrap() != LearningFit::NoCurve
    });
    let share = mistaken.count() as f64 / 400.0;
    assert!(share < 0.085, "5 % and three standard errors: {share}");
}

#[test]
fn intervals_of_noisy_curves_hold_the_truth_however_few_sessions_there_are() {
    for (count, tau) in [(8, 2.0), (20, 4.0)] {
        hold_the_truth(count, tau);
    }
}

fn hold_the_truth(count: u32, tau: f64) {
    let (mut chance, mut held, mut curves) = (Resampler::of([7.0]), [0; 3], 0);
    for _ in 0..200 {
        let mut noise = || 6.0 * gauss(&mut chance);
        let (truth, at) = ([50.0, 120.0, tau], exact(50.0, 120.0, tau));
        let LearningFit::Curve(got) = fit(&sessions(count, |number| at(number) + noise()), Direction::Lower).unwrap()
        else {
            continue;
        };
        curves += 1;
        for (held, (fitted, truth)) in
            held.iter_mut().zip([got.plateau, got.distance, got.tau_sessions].into_iter().zip(truth))
        {
            *held += usize::from(fitted.interval.contains(truth));
        }
    }
    assert!(curves > 190, "{curves} of {count}");
    for held in held {
        let share = held as f64 / f64::from(curves);
        // 95 % minus three standard errors of this number of curves.
        assert!((0.90..1.0).contains(&share), "{share} of {count} sessions");
    }
}

#[test]
fn a_band_holds_the_curve_and_narrows_with_the_sessions() {
    let mut chance = Resampler::of([11.0]);
    let at = exact(50.0, 120.0, 4.0);
    let mut of = |count: u32| curve(&sessions(count, |number| at(number) + 6.0 * gauss(&mut chance)), Direction::Lower);
    let (few, many) = (of(12), of(120));
    for number in 1..=12 {
        let (rough, tight) = (few.band(number), many.band(number));
        assert!(rough.contains(few.value_at(number)) && tight.contains(many.value_at(number)), "{number}");
        assert!(tight.contains(at(number)) || number == 1, "{number}: {tight:?}, not {}", at(number));
    }
    let width = |band: ConfidenceInterval| band.high - band.low;
    assert!(width(many.band(12)) < 0.5 * width(few.band(12)));
}

/// Makes no claim about time: prints the cost of a fit on this machine, for the figure in this module's text.
#[test]
#[ignore = "measures: run it optimised and alone"]
fn what_a_fit_costs() {
    let mut chance = Resampler::of([1.0]);
    let at = exact(50.0, 120.0, 30.0);
    for count in [20, 100, 500] {
        let rows = sessions(count, |number| at(number) + 12.0 * gauss(&mut chance));
        let started = std::time::Instant::now();
        (0..20).for_each(|_| drop(curve(&rows, Direction::Lower)));
        println!("{count} sessions: {:.1} ms", started.elapsed().as_secs_f64() * 1e3 / 20.0);
    }
}

#[test]
fn bad_input_gives_a_reason() {
    let of = |numbers: &[u32], value: f64| {
        let rows: Vec<NumberedValue> = numbers.iter().map(|number| NumberedValue { number: *number, value }).collect();
        fit(&rows, Direction::Lower)
    };
    assert_eq!(of(&[], 1.0), Ok(LearningFit::TooFew { found: 0, needed: 6 }));
    assert_eq!(of(&[1, 2, 3, 4, 5], 1.0), Ok(LearningFit::TooFew { found: 5, needed: 6 }));
    assert_eq!(of(&[1, 2, 3, 4, 5, 6], f64::NAN), Err(NoAnswer::NotFinite));
    assert_eq!(of(&[1, 2, 3, 3, 5, 6], 1.0), Err(NoAnswer::NotInOrder));
    assert_eq!(of(&[2, 1, 3, 4, 5, 6], 1.0), Err(NoAnswer::NotInOrder));
    assert_eq!(of(&[0, 1, 3, 4, 5, 6], 1.0), Err(NoAnswer::NotInOrder));
    assert_eq!(fit(&[], Direction::Neither), Err(NoAnswer::NoDirection));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn scaled_and_mirrored_values_have_the_scaled_and_mirrored_curve(seed in 0u32..1000, scale in 0.01f64..100.0) {
        let mut chance = Resampler::of([f64::from(seed)]);
        let at = exact(50.0, 120.0, 4.0);
        let rows = sessions(12, |number| at(number) + 5.0 * gauss(&mut chance));
        let turn = |row: &NumberedValue| NumberedValue { value: -scale * row.value, ..*row };
        let turned: Vec<NumberedValue> = rows.iter().map(turn).collect();
        let (one, other) = (curve(&rows, Direction::Lower), curve(&turned, Direction::Higher));
        prop_assert!((other.plateau.value + scale * one.plateau.value).abs() < 1e-4 * scale * one.plateau.value.abs());
        prop_assert!((other.tau_sessions.value - one.tau_sessions.value).abs() < 1e-4 * one.tau_sessions.value);
        prop_assert_eq!(&one, &curve(&rows, Direction::Lower));
    }
}
