// Where people stand in a feature, one dot a person, with a limit that can be moved: the service says whom it would be wrong about.
import { html, useEffect, useState } from './preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { number, percent, unit } from '../format.js';
import { t } from '../texts.js';
import { Field } from './form.js';
import { Empty, Loading, ProblemNotice } from './notice.js';
import { SpreadPlot } from './spread_plot.js';
import { limitable, toolChoices } from './standard_target.js';

const words = t.spread;
const STEPS = 200;
const WAIT_MS = 250; // Between the last move of the line and the question what it does.

export function Spread({ data: { task, standards, features, cohorts, tools }, onTake }) {
  const target = standards[0]?.targets[0];
  const [of, setOf] = useState({ feature: target?.feature ?? 'duration', tool: target?.tool ?? '', hand: target?.made_from?.handedness ?? 'right',
    first: '', second: '' });
  const known = targetOf(standards[0], of);
  const [moved, setMoved] = useState(null);
  const limit = moved ?? known?.limit ?? null;
  const settled = useSettled(limit);
  const feature = features.find(one => one.name === of.feature);
  const tool = feature?.of_tools ? of.tool : '';
  const isReady = !feature || feature.of_session || tool !== '';
  const groups = [of.first, of.second].filter(Boolean).join(',');
  const { data, current, problem, reload } = useData(
    signal => isReady ? api.tasks.distribution(task.id, { feature: of.feature, tool, cohorts: groups, hand: tool && of.hand, limit: settled }, signal) : null,
    [task.id, of.feature, tool, groups, of.hand, settled, isReady]);
  const set = name => event => {
    setOf({ ...of, [name]: event.target.value });
    if (name === 'feature' || name === 'tool') setMoved(null);
  };
  const people = [['', words.everybody], ...cohorts.map(one => [one.code, t.standardForm.cohortOf(one.name, one.people)])];
  const shown = data && data.feature === of.feature && (data.tool ?? '') === tool ? data : null;
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="filters">
        <${Field} type="select" label=${words.feature} value=${of.feature} onInput=${set('feature')}
          options=${limitable(features).map(one => [one.name, one.title])} />
        ${feature?.of_tools && html`<${Field} type="select" label=${words.tool} value=${tool} onInput=${set('tool')}
          options=${toolChoices(feature, tools)} />`}
        ${tool && html`<${Field} type="select" label=${words.hand} value=${of.hand} onInput=${set('hand')}
          options=${Object.entries(t.trainees.hands)} />`}
        ${cohorts.length > 0 && html`<${Field} type="select" label=${words.first} value=${of.first} options=${people} onInput=${set('first')} />
          <${Field} type="select" label=${words.second} value=${of.second} onInput=${set('second')}
            options=${[['', words.nobody], ...people.slice(1)]} />`}
      </div>
      <div class="body stack">
        <p class="small muted">${words.lead}</p>
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${isReady && !shown && !problem && html`<${Loading} />`}
        ${shown && html`<${Told} told=${shown} isFresh=${shown === current && limit === settled} limit=${limit} known=${known?.limit} isNovices=${of.first !== ''} onMove=${setMoved}
          onTake=${() => onTake({ feature: of.feature, tool, limit })} />`}
      </div>
    </section>`;
}

const targetOf = (standard, { feature, tool }) =>
  standard?.targets.find(one => one.feature === feature && (one.tool ?? '') === tool);

/** The value once it has stood still for a moment. */
function useSettled(value) {
  const [settled, setSettled] = useState(value);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), WAIT_MS);
    return () => clearTimeout(timer);
  }, [value]);
  return settled;
}

/** `isFresh`: is it told of this limit? The dots stand there meanwhile; shares of another limit would not be true of this one. */
function Told({ told, isFresh, limit, known, isNovices, onMove, onTake }) {
  const values = told.groups.flatMap(group => group.values);
  if (!values.length) return html`<${Empty} title=${words.none} body=${words.noneBody} />`;
  const [low, high, step] = ends(values, known, limit);
  const move = event => event.target.value !== '' && onMove(Number(event.target.value));
  return html`
    <${SpreadPlot} told=${told} limit=${limit} ends=${[low, high]} />
    <div class="slide">
      <div class="field"><label for="spread-slide">${words.slide}</label>
        <input id="spread-slide" type="range" min=${low} max=${high} step=${step} value=${limit ?? (low + high) / 2}
          onInput=${move} /></div>
      <${Limit} name=${unit(told.unit)} limit=${limit} onMove=${move} />
      <button class="button" type="button" disabled=${limit === null} onClick=${onTake}>${words.take}</button>
    </div>
    <ul class="stack tight" aria-live="polite" aria-busy=${!isFresh}>
      ${limit === null ? html`<li class="muted">${words.noLimit}</li>`
        : told.groups.map((group, at) => html`<li key=${group.cohort}>${isFresh ? said(group, at, isNovices, told.groups.length) : `${nameOf(group)}: …`}</li>`)}
    </ul>`;
}

/** The number beside the slider, which follows it without losing what is being typed. */
function Limit({ name, limit, onMove }) {
  const [typed, setTyped] = useState(null);
  const shown = typed ?? (limit === null ? '' : String(Number(limit.toPrecision(4))));
  return html`
    <div class="field"><label for="spread-limit">${words.limit(name)}</label>
      <input id="spread-limit" type="number" step="any" value=${shown} onInput=${event => (setTyped(event.target.value), onMove(event))}
        onBlur=${() => setTyped(null)} /></div>`;
}

const nameOf = group => group.name ?? words.everybody;

function said(group, at, isNovices, count) {
  const name = nameOf(group);
  if (!group.keeping) return group.withheld ? words.withheld(name, group.withheld.detail) : `${name}: …`;
  const share = of => words.seenOf(percent(of.seen), percent(of.low), percent(of.high), percent(of.expected));
  const isSecond = at === count - 1 && (count === 2 || !isNovices) && group.cohort !== null;
  if (isSecond) return words.falseFail(name, share(group.breaking));
  return group.cohort === null ? words.keeps(name, share(group.keeping)) : words.falsePass(name, share(group.keeping));
}

/** Room beside the outermost values and the limit in use, and round steps between; a limit that was typed beyond has room, too. */
function ends(values, known, limit) {
  const all = known === undefined ? values : [...values, known];
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const room = (high - low || Math.abs(high) || 1) * 0.15;
  const step = 10 ** Math.floor(Math.log10((high - low + 2 * room) / STEPS));
  const round = (value, to) => Number((to(value / step) * step).toPrecision(12));
  return [round(Math.min(low - room, limit ?? low), Math.floor), round(Math.max(high + room, limit ?? high), Math.ceil), step];
}
