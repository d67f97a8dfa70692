// What a trainee's sessions say, in words: place, learning, pass rule, charts, reminders. What is not known says what is missing.
import { html } from './preact.js';
import { date, number, percent, unit } from '../format.js';
import { t } from '../texts.js';

const words = t.trainee;

/** Rows of what there is to say about one feature and the whole standard. */
export function ProgressWords({ progress, series }) {
  const rows = [
    [words.placeName, progress.cohort ? place(series, progress.cohort) : words.noCohort],
    [words.learningName, learning(series)],
    [words.ruleName, progress.rule ? rule(progress.rule) : progress.standard ? words.noRule : words.noStandard],
    [words.chartsName, progress.charts ? charts(progress.charts) : words.noStandard],
    [words.remindersName, progress.reminders.length ? progress.reminders.map(reminder).join(' ') : words.noReminders],
  ];
  return html`<dl class="facts">${rows.map(([name, said]) => html`
    <dt>${name}</dt><dd>${said}</dd>`)}</dl>`;
}

/** `not enough: 4 more`, or the reason. */
const withheld = why => (why.missing ? words.notEnough(why.missing, why.detail) : words.withheld(why.detail));

function place({ place: at, no_place: why }, cohort) {
  if (!at) return why ? withheld(why) : words.noCohort;
  const of = at.better_than ?? at.percentile;
  const [low, high] = [of.low, of.high].map(Math.round);
  const say = at.better_than ? words.better : words.above;
  return `${say(Math.round(of.value), low, high, at.people, cohort.name)}${at.error_known ? '' : ` ${words.ownErrorUnknown}`}`;
}

function learning({ learning: { state, curve, forecast, withheld: why }, unit: name }) {
  if (state !== 'curve') return why ? withheld(why) : words.learning[state];
  const { plateau, tau_sessions: tau } = curve;
  const level = `${number(plateau.value)} (${number(plateau.low)} – ${number(plateau.high)}) ${unit(name)}`.trim();
  const said = words.curve(level, number(tau.value), number(tau.low), number(tau.high));
  return forecast ? `${said} ${forecastWords(forecast)}` : said;
}

function forecastWords({ state, at, earliest, latest, withheld: why }) {
  if (state === 'withheld') return withheld(why);
  if (state === 'reached') return words.forecast.reached(at);
  if (state === 'ahead') return words.forecast.ahead(at, earliest, latest);
  return words.forecast.never(earliest);
}

function rule(of) {
  const asked = words.rule(of.in_a_row, of.then_more, of.at_most);
  if (of.state === 'met') return `${asked} ${words.ruleMet(of.met_at)}`;
  if (of.state === 'out_of_reach') return `${asked} ${words.ruleOutOfReach}`;
  const unknown = of.unknown ? ` ${words.unknown(of.unknown)}` : '';
  return `${asked} ${words.ruleOpen(of.have_in_a_row, of.in_a_row, of.have_more, of.then_more)}${unknown}`;
}

function charts(of) {
  const last = of.events[of.events.length - 1];
  const state = words.standing[of.standing](last?.session, of.judged);
  const rates = words.rates(percent(of.declared_wrongly), percent(of.declared_rightly), of.design.declare_within);
  return `${state} ${rates}`;
}

const reminder = ({ due_at, state, done_at }) =>
  words.reminder[state](date(due_at), done_at && date(done_at));
