// A standard is set in two steps: the service calculates it, with how many people it is based on and how many it would
// judge wrongly; then it is set.
import { html, useEffect, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { t } from '../../texts.js';
import { reasonText } from '../../translate.js';
import { focusSoon } from '../forms/focus.js';
import { Field } from '../forms/form.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { RuleAndChart, standardInUse, Targets } from './standard.js';
import { Effect } from './standard_effect.js';
import { initialTargets, isSameTarget, newTarget, TargetFields, targetRequest, withChosenLimit } from './standard_target.js';

const words = t.standardForm;
const [TOP, CHOSEN] = ['standard-form', 'standard-form-chosen']; // Ids that get the focus.
const RULE = ['in_a_row', 'then_more', 'at_most'];

/**
 * `first`: a feature and a limit that were chosen elsewhere on the page, a new object for each choice. One that arrives
 * while the form is open is added to it; typed values stay. null: begin with the standard in use.
 */
export function StandardForm({ data, first, mayMake, onSet, onCancel }) {
  const inUse = standardInUse(data.standards) ?? data.standards[0];
  const [targets, setTargets] = useState(() => initialTargets(first, data, mayMake));
  const [rule, setRule] = useState(() => ({ in_a_row: '', then_more: '', at_most: '', ...ruleValues(inUse?.rule) }));
  const [start, setStart] = useState({ from: 'now', day: '' });
  const [proposal, setProposal] = useState(null);
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(null);
  const lastFirst = useRef(first);
  useEffect(() => {
    if (lastFirst.current !== first) setTargets(before => withChosenLimit(before, first));
    lastFirst.current = first;
    focusSoon(first ? CHOSEN : TOP);
  }, [first]);
  const chosen = first ? targets.findIndex(target => isSameTarget(target, first)) : -1;

  const body = { targets: targets.map(target => targetRequest(target, data.features)), rule: ruleRequest(rule), charts: inUse?.charts,
    valid_from: start.from === 'day' ? start.day : start.from };
  const sent = JSON.stringify(body);
  const isFresh = proposal?.sent === sent;
  const run = async (what, work) => {
    setBusy(what);
    setProblem(null);
    await work().catch(error => setProblem(asProblem(error)));
    setBusy(null);
  };
  const propose = event => {
    event.preventDefault();
    return run('propose', async () => setProposal({ sent, answer: await api.tasks.propose(data.task.id, body) }));
  };
  const save = () => run('set', async () => onSet(await api.tasks.setStandard(data.task.id, body)));
  const drop = target => (setTargets(targets.filter(one => one !== target)), focusSoon(TOP));
  const change = (at, more) => setTargets(before => before.map((target, i) => (i === at ? { ...target, ...more } : target)));
  return html`
    <section class="card">
      <header><h2 id=${TOP} tabindex="-1">${words.title}</h2></header>
      <form class="body stack" onSubmit=${propose}>
        <p class="muted">${words.lead}</p>
        ${!mayMake && html`<p class="muted">${words.onlyAdministrators}</p>`}
        ${targets.map((target, at) => html`
          <fieldset class="plain target stack tight" key=${target.key} tabindex="-1" id=${at === chosen ? CHOSEN : undefined}>
            <legend class="label">${words.target(at + 1)}</legend>
            <${TargetFields} target=${target} data=${data} mayMake=${mayMake} onChange=${more => change(at, more)} />
            ${targets.length > 1 && html`<div><button class="button bare" type="button" aria-label=${words.drop(at + 1)}
              onClick=${() => drop(target)}>${t.form.remove}</button></div>`}
          </fieldset>`)}
        <div><button class="button" type="button" onClick=${() => setTargets([...targets, newTarget(data)])}>
          ${words.addTarget}</button></div>
        <${RuleFields} rule=${rule} onChange=${more => setRule({ ...rule, ...more })} />
        <${StartFields} start=${start} onChange=${more => setStart({ ...start, ...more })} />
        <${ProblemNotice} problem=${problem} />
        <div class="row">
          <button class=${`button ${isFresh ? '' : 'main'}`} type="submit" disabled=${busy !== null}>
            ${busy === 'propose' ? words.proposing : words.propose}</button>
          <button class="button" type="button" onClick=${onCancel}>${t.form.cancel}</button>
        </div>
        ${proposal && html`<${Proposal} answer=${proposal.answer} isFresh=${isFresh} busy=${busy} onSet=${save} />`}
      </form>
    </section>`;
}

const ruleValues = rule => rule && Object.fromEntries(RULE.map(name => [name, rule[name] ?? '']));

/** Without passes in a row there is no rule. */
const ruleRequest = rule =>
  rule.in_a_row === '' ? undefined
    : { in_a_row: Number(rule.in_a_row), then_more: Number(rule.then_more), at_most: rule.at_most === '' ? undefined : Number(rule.at_most) };

function RuleFields({ rule, onChange }) {
  const field = (name, label, hint, min) => html`<${Field} type="number" name=${name} label=${label} hint=${hint} min=${min} max="1000" step="1"
    value=${rule[name]} onInput=${event => onChange({ [name]: event.target.value })} />`;
  return html`
    <fieldset class="plain stack tight">
      <legend class="label">${words.rule}</legend>
      <div class="fields">
        ${field('in_a_row', words.inARow, words.inARowHint, 1)}
        ${field('then_more', words.thenMore, null, 0)}
        ${field('at_most', words.atMost, words.atMostHint, 1)}
      </div>
    </fieldset>`;
}

/** @param {Props} props */
const StartFields = ({ start, onChange }) => html`
  <fieldset class="plain stack tight">
    <legend class="label">${words.start}</legend>
    <div class="fields">
      <${Field} type="select" name="start" label=${words.startFrom} value=${start.from} options=${Object.entries(words.starts)}
        hint=${words.startHints[start.from]} onInput=${event => onChange({ from: event.target.value })} />
      ${start.from === 'day' && html`<${Field} type="date" name="day" required label=${words.startDay} value=${start.day}
        onInput=${event => onChange({ day: event.target.value })} />`}
    </div>
  </fieldset>`;

function Proposal({ answer, isFresh, busy, onSet }) {
  const computed = answer.targets.filter(one => one.target).map(one => one.target);
  const withheld = answer.targets.filter(one => !one.target);
  return html`
    <section class="proposal stack" aria-label=${words.proposal} aria-live="polite">
      <h3>${words.proposal}</h3>
      ${!isFresh && html`<${Notice} tone="warn" title=${words.changed} />`}
      ${computed.length > 0 && html`<${Targets} targets=${computed} />`}
      ${withheld.map((one, i) => html`<p key=${i} class="notice warn"><span>${words.withheld(words.target(
        answer.targets.indexOf(one) + 1), reasonText(one.withheld))} ${one.withheld.missing ? words.missing(one.withheld.missing) : ''}</span></p>`)}
      <${RuleAndChart} standard=${answer} />
      ${answer.effect && html`<${Effect} effect=${answer.effect} />`}
      ${withheld.length ? html`<p class="muted">${words.notYet}</p>`
        : html`<div><button class="button main" type="button" disabled=${!isFresh || busy !== null} onClick=${onSet}>
          ${busy === 'set' ? words.setting : words.set}</button></div>`}
    </section>`;
}
