// A trainee's progress in words: place, learning, pass rule, charts, reminders. If something is unknown, it says what
// is missing.
import { html } from '../../preact.js';
import { date, number, percent, unit } from '../../format.js';
import { t } from '../../texts.js';
import { reasonText } from '../../translate.js';

const words = t.trainee;

/** Rows about one feature and about the whole standard. @param {Props} props */
export function ProgressSummary({ progress, series }) {
  const rows = [
    [words.placeName, progress.cohort ? placeText(series, progress.cohort) : words.noCohort],
    [words.learningName, learningText(series)],
    ...(progress.passed ? [[words.passedName, words.passedUnder(date(progress.passed.at), progress.passed.standard)]] : []),
    [words.ruleName, progress.rule ? ruleText(progress.rule) : progress.standard ? words.noRule : words.noStandard],
    [words.chartsName, progress.charts ? chartsText(progress.charts) : words.noStandard],
    [words.remindersName, progress.reminders.length ? progress.reminders.map(reminderText).join(' ') : words.noReminders],
  ];
  return html`<dl class="facts">${rows.map(([name, text]) => html`
    <dt>${name}</dt><dd>${text}</dd>`)}</dl>`;
}

/** `not enough: 4 more`, or the reason. */
const withheld = why => (why.missing ? words.notEnough(why.missing, reasonText(why)) : words.withheld(reasonText(why)));

/**
 * @param {Schemas['TraineeProgressResponse']['features'][number]} series
 * @param {{ name: string }} cohort
 */
function placeText({ place: at, no_place: why }, cohort) {
  if (!at) return why ? withheld(why) : words.noCohort;
  const interval = at.better_than ?? at.percentile;
  const [low, high] = [interval.low, interval.high].map(Math.round);
  const phrase = at.better_than ? words.better : words.above;
  return `${phrase(Math.round(interval.value), low, high, at.people, cohort.name)}${at.error_known ? '' : ` ${words.ownErrorUnknown}`}`;
}

/** @param {Schemas['TraineeProgressResponse']['features'][number]} series */
function learningText({ learning: { state, curve, forecast, withheld: why }, unit: name }) {
  if (state !== 'curve' || !curve) return why ? withheld(why) : words.learning[state];
  const { plateau, tau_sessions: tau } = curve;
  const level = `${number(plateau.value)} (${number(plateau.low)} – ${number(plateau.high)}) ${unit(name)}`.trim();
  const text = words.curve(level, number(tau.value), number(tau.low), number(tau.high));
  return forecast ? `${text} ${forecastWords(forecast)}` : text;
}

/** @param {NonNullable<Schemas['TraineeProgressResponse']['features'][number]['learning']['forecast']>} forecast */
function forecastWords({ state, at, earliest, latest, withheld: why }) {
  if (state === 'withheld') return withheld(why);
  if (state === 'reached') return words.forecast.reached(at);
  if (state === 'ahead') return words.forecast.ahead(at, earliest, latest);
  return words.forecast.never(earliest);
}

function ruleText(rule) {
  const ruleWords = words.rule(rule.in_a_row, rule.then_more, rule.at_most);
  if (rule.state === 'met') return `${ruleWords} ${words.ruleMet(rule.met_at)}`;
  if (rule.state === 'out_of_reach') return `${ruleWords} ${words.ruleOutOfReach}`;
  const unknown = rule.unknown ? ` ${words.unknown(rule.unknown)}` : '';
  return `${ruleWords} ${words.ruleOpen(rule.have_in_a_row, rule.in_a_row, rule.have_more, rule.then_more)}${unknown}`;
}

function chartsText(charts) {
  const last = charts.events[charts.events.length - 1];
  const state = words.standing[charts.standing](last?.session, charts.judged);
  const rates = words.rates(percent(charts.declared_wrongly), percent(charts.declared_rightly), charts.design.declare_within);
  return `${state} ${rates}`;
}

/** @param {Schemas['TraineeProgressResponse']['reminders'][number]} reminder */
const reminderText = ({ due_at, state, done_at }) =>
  words.reminder[state](date(due_at), done_at && date(done_at));
