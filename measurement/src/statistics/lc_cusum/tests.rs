//! Known figures, hand-made histories, and 10,000 simulated ones against the stated rates.

use super::*;
use crate::statistics::resampler::Resampler;

const CAREERS: usize = 10_000;

fn monitor() -> LcCusumMonitor {
    LcCusumMonitor::new(LcCusumDesign::default()).unwrap()
}

fn trials(letters: &str) -> Vec<TrialOutcome> {
    let of = |letter| match letter {
        'p' => TrialOutcome::Passed,
        'f' => TrialOutcome::Failed,
        _ => TrialOutcome::Unknown,
    };
    letters.chars().map(of).collect()
}

/// Trials of a trainee who misses this share of them.
fn missing(share: f64, count: usize, chance: &mut Resampler) -> Vec<TrialOutcome> {
    let one =
        |_| if (chance.pick(1_000_000) as f64) < share * 1e6 { TrialOutcome::Failed } else { TrialOutcome::Passed };
    (0..count).map(one).collect()
}

fn share_of_careers(holds: impl FnMut(usize) -> bool) -> f64 {
    let mut holds = holds;
    (0..CAREERS).filter(|career| holds(*career)).count() as f64 / CAREERS as f64
}

#[test]
fn limits_and_powers_are_those_of_an_independent_computation() {
    // A separate program in another language, over dictionaries of reached scores, computed: the limit to declare; the
    // shares of adequate trainees declared by trials 30, 50 and 100; the limit of the alarm; the trials until half and
    // nine of ten relapses are found.
    let cases = [
        ((0.30, 0.10, 50), 4.150_241, [0.598_125, 0.905_844, 0.997_279], 4.789_510, (24, 51)),
        ((0.30, 0.10, 100), 4.940_041, [0.358_017, 0.812_122, 0.991_764], 4.789_510, (24, 51)),
        ((0.15, 0.05, 100), 4.045_055, [0.0, 0.367_128, 0.863_567], 4.033_484, (41, 94)),
        ((0.50, 0.20, 50), 4.723_753, [0.834_607, 0.977_166, 0.999_841], 5.351_118, (19, 38)),
    ];
    for ((inadequate, adequate, declare_within), declare, powers, alarm, found) in cases {
        let got =
            LcCusumMonitor::new(LcCusumDesign { inadequate, adequate, declare_within, ..LcCusumDesign::default() })
                .unwrap();
        let (to_declare, to_alarm) = got.limits();
        assert!((to_declare - declare).abs() < 1e-5 && (to_alarm - alarm).abs() < 1e-5, "{:?}", got.limits());
        for (by, power) in [30, 50, 100].into_iter().zip(powers) {
            assert!((got.declared_rightly[by - 1] - power).abs() < 1e-5, "by {by}: {}", got.declared_rightly[by - 1]);
        }
        assert_eq!((got.relapse_found_median, got.relapse_found_90), (Some(found.0), Some(found.1)));
    }
}

#[test]
fn seventeen_passes_in_a_row_declare_and_a_row_of_misses_is_a_relapse() {
    // A pass adds ln(9/7) = 0.2513; the limit is 4.1502, so 16 passes (4.021) do not declare. A miss then adds ln 3.
    let career = monitor().follow(&trials(&("p".repeat(17) + "fffff")));
    let CompetenceEvent::Declared { at: 17, judged: 17, wrong_by_then: Some(wrong) } = career.events[0] else {
        panic!("{career:?}");
    };
    assert!((wrong - 0.7f64.powi(17)).abs() < 1e-12, "only seventeen passes declare at the 17th trial");
    assert_eq!(career.events[1..], [CompetenceEvent::Relapsed { at: 22, judged: 5 }]);
    assert_eq!((career.standing, career.judged), (Standing::Relapsed, 0));
    assert_eq!(career.path.len(), 22);
}

#[test]
fn too_few_trials_say_not_yet() {
    for few in ["", "p", "ppppppppp", "fff", "????????????????????????"] {
        let career = monitor().follow(&trials(few));
        assert_eq!((career.standing, career.events.len(), career.path.len()), (Standing::NotYet, 0, few.len()));
    }
}

#[test]
fn an_unknown_trial_moves_nothing_and_is_shown_as_a_gap() {
    let known = monitor().follow(&trials("ppppppppppppppppppffppp"));
    let gaps = monitor().follow(&trials("pppp?pppppppp??ppppppff?ppp"));
    let judged: Vec<_> = gaps.path.iter().flatten().collect();
    assert_eq!(judged, known.path.iter().flatten().collect::<Vec<_>>());
    assert_eq!(gaps.path.iter().filter(|point| point.is_none()).count(), 4);
    assert!(matches!(gaps.events[0], CompetenceEvent::Declared { at: 20, judged: 17, .. }), "{:?}", gaps.events);
}

#[test]
fn of_10000_incompetent_careers_at_most_the_stated_share_is_declared() {
    let (monitor, mut chance) = (monitor(), Resampler::of([1.0]));
    let declared = share_of_careers(|_| !monitor.follow(&missing(0.3, 50, &mut chance)).events.is_empty());
    // Stated: at most 5 %; exactly 4.91 %. Three standard errors of 10,000 draws are 0.65 %.
    assert!((declared - monitor.declared_wrongly[49]).abs() < 0.0065, "{declared}");
    assert!(monitor.declared_wrongly[49] <= 0.05);
}

#[test]
fn of_10000_adequate_careers_nine_of_ten_are_declared_within_50_trials() {
    let (monitor, mut chance) = (monitor(), Resampler::of([2.0]));
    let declared = share_of_careers(|_| !monitor.follow(&missing(0.1, 50, &mut chance)).events.is_empty());
    assert!((declared - 0.9058).abs() < 0.009, "{declared}");
}

#[test]
fn relapses_are_found_within_the_stated_trials_and_alarms_are_rare_without_one() {
    let (monitor, mut chance) = (monitor(), Resampler::of([3.0]));
    let learnt = trials(&"p".repeat(17));
    let alarm_within = |within: usize, misses: f64, chance: &mut Resampler| {
        share_of_careers(|_| {
            let career = monitor.follow(&[learnt.clone(), missing(misses, within, chance)].concat());
            career.events.iter().any(|event| matches!(event, CompetenceEvent::Relapsed { .. }))
        })
    };
    let median = alarm_within(monitor.relapse_found_median.unwrap(), 0.3, &mut chance);
    let most = alarm_within(monitor.relapse_found_90.unwrap(), 0.3, &mut chance);
    assert!((0.485..0.54).contains(&median) && (0.89..0.92).contains(&most), "{median} {most}");
    let needless = alarm_within(100, 0.1, &mut chance);
    assert!(needless <= 0.0565, "{needless}");
}

#[test]
fn a_design_that_cannot_decide_is_refused() {
    let refused = |design: LcCusumDesign| LcCusumMonitor::new(design).map(drop);
    let usual = LcCusumDesign::default();
    let chances = Err(NoAnswer::UnusableSetting("chances"));
    assert_eq!(refused(LcCusumDesign { adequate: 0.3, ..usual }), chances);
    assert_eq!(refused(LcCusumDesign { inadequate: f64::NAN, ..usual }), chances);
    assert_eq!(refused(LcCusumDesign { adequate: 0.0, ..usual }), chances);
    assert_eq!(refused(LcCusumDesign { declare_within: 0, ..usual }), Err(NoAnswer::UnusableSetting("trials")));
    assert_eq!(refused(LcCusumDesign { false_alarm: 1.0, ..usual }), Err(NoAnswer::UnusableSetting("share")));
}
