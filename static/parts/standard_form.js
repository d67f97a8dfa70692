// A standard is set in two steps: worked out first, with from how many people and whom it would be wrong about, then set.
import { html, useEffect, useRef, useState } from './preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { t } from '../texts.js';
import { focusSoon } from './focus.js';
import { Field } from './form.js';
import { Notice, ProblemNotice } from './notice.js';
import { RuleAndChart, Targets } from './standard.js';
import { another, asked, begun, isOf, taken, TargetFields } from './standard_target.js';

const words = t.standardForm;
const [TOP, CHOSEN] = ['standard-form', 'standard-form-chosen']; // What gets the focus.
const RULE = ['in_a_row', 'then_more', 'at_most'];

/**
 * `first`: a feature and a limit that were chosen elsewhere, anew for each choice: one that comes while the form is open is taken
 * into it, and what was typed stays. null: begin with the standard in use.
 */
export function StandardForm({ data, first, mayMake, onSet, onCancel }) {
  const last = data.standards[0];
  const [targets, setTargets] = useState(() => begun(first, data, mayMake));
  const [rule, setRule] = useState(() => ({ in_a_row: '', then_more: '', at_most: '', ...kept(last?.rule) }));
  const [proposal, setProposal] = useState(null);
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(null);
  const known = useRef(first);
  useEffect(() => {
    if (known.current !== first) setTargets(before => taken(before, first));
    known.current = first;
    focusSoon(first ? CHOSEN : TOP);
  }, [first]);
  const chosen = first ? targets.findIndex(target => isOf(target, first)) : -1;

  const body = { targets: targets.map(target => asked(target, data.features)), rule: askedRule(rule), charts: last?.charts };
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
    return run('propose', async () => setProposal({ sent, told: await api.tasks.propose(data.task.id, body) }));
  };
  const keep = () => run('set', async () => onSet(await api.tasks.setStandard(data.task.id, body)));
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
        <div><button class="button" type="button" onClick=${() => setTargets([...targets, another(data)])}>
          ${words.addTarget}</button></div>
        <${RuleFields} rule=${rule} onChange=${more => setRule({ ...rule, ...more })} />
        <${ProblemNotice} problem=${problem} />
        <div class="row">
          <button class=${`button ${isFresh ? '' : 'main'}`} type="submit" disabled=${busy !== null}>
            ${busy === 'propose' ? words.proposing : words.propose}</button>
          <button class="button" type="button" onClick=${onCancel}>${t.form.cancel}</button>
        </div>
        ${proposal && html`<${Proposal} told=${proposal.told} isFresh=${isFresh} busy=${busy} onSet=${keep} />`}
      </form>
    </section>`;
}

const kept = rule => rule && Object.fromEntries(RULE.map(name => [name, rule[name] ?? '']));

/** Without passes in a row there is no rule. */
const askedRule = rule =>
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

function Proposal({ told, isFresh, busy, onSet }) {
  const made = told.targets.filter(one => one.target).map(one => one.target);
  const withheld = told.targets.filter(one => !one.target);
  return html`
    <section class="proposal stack" aria-label=${words.proposal} aria-live="polite">
      <h3>${words.proposal}</h3>
      ${!isFresh && html`<${Notice} tone="warn" title=${words.changed} />`}
      ${made.length > 0 && html`<${Targets} targets=${made} />`}
      ${withheld.map((one, i) => html`<p key=${i} class="notice warn"><span>${words.withheld(words.target(
        told.targets.indexOf(one) + 1), one.withheld.detail)} ${one.withheld.missing ? words.missing(one.withheld.missing) : ''}</span></p>`)}
      <${RuleAndChart} standard=${told} />
      ${withheld.length ? html`<p class="muted">${words.notYet}</p>`
        : html`<div><button class="button main" type="button" disabled=${!isFresh || busy !== null} onClick=${onSet}>
          ${busy === 'set' ? words.setting : words.set}</button></div>`}
    </section>`;
}
