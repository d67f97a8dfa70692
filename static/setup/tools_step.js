// Step 4: the instruments, with tape or bare, and their sizes. Depth is measured by them, so a tenth of a millimetre
// counts.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { focusSoon } from '../parts/forms/focus.js';
import { icons } from '../parts/page/icons.js';
import { Empty, Notice, ProblemNotice } from '../parts/page/notice.js';
import { isBare, toolEntry } from './marks.js';
import { mayBeBare, withAdded, withChange, withKind } from './planned_tools.js';
import { BAND_MM, DIAMETER_MM, isOutdated, isResized, plannedTool } from './steps.js';
import { BareToolPicture, ToolPicture } from './tool_picture.js';
import { tapeNames } from './tapes.js';

const words = t.setup.tools;
const MAX_TOOLS = 8;
const ADD = 'add-tool';

/** @param {Props} props */
export function ToolsStep({ box, draft, stepHref, onChange }) {
  const { tools } = draft.plan;
  const known = box.tools.length > 0 && tools.length === 0;
  const set = list => draft.setPlan({ tools: list });
  const remove = index => (set(tools.filter((_, at) => at !== index)), focusSoon(ADD, 'setup-step'));
  // Fields keep their first value: new ids make them start again.
  const restoreTools = () => {
    const last = Math.max(...tools.map(({ id }) => id));
    set(box.palettes[0].tools.map(plannedTool).map(tool => ({ ...tool, id: last + tool.id })));
    focusSoon(ADD, 'setup-step');
  };
  return html`
    ${!tools.every(isBare) && html`<${How} picture=${ToolPicture} lines=${words.how} />`}
    ${tools.some(isBare) && html`<${How} picture=${BareToolPicture} lines=${words.bare.how} />`}
    <datalist id="tapes">${tapeNames.map(name => html`<option key=${name} value=${name} />`)}</datalist>
    ${known && html`<${Known} tools=${box.tools} onTake=${() => set(box.tools.map(plannedTool))} />`}
    ${tools.length === 0 && !known && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
    <ul class="stack">
      ${tools.map((tool, index) => html`<${Tool} key=${tool.id} tool=${tool} number=${index + 1}
        isFree=${mayBeBare(tools, index)} onKind=${bare => set(withKind(tools, index, bare))}
        onChange=${more => set(withChange(tools, index, more))} onRemove=${() => remove(index)} />`)}
    </ul>
    ${!known && tools.length < MAX_TOOLS && html`<div class="row"><button id=${ADD} class="button" type="button"
      onClick=${() => set(withAdded(tools))}><${icons.add} />${words.add}</button></div>`}
    ${isOutdated(tools, box.palettes[0]) && html`
      ${isResized(tools, box.palettes[0]) ? html`<${SaveSizes} box=${box} tools=${tools} onChange=${onChange} />`
        : html`<${Notice} tone="warn" quiet title=${t.setup.colours.outdated}>${t.setup.colours.outdatedBody}<//>`}
      <div class="row"><button class="button" type="button" onClick=${restoreTools}>${words.takeBack}</button></div>`}
    ${tools.length > 0 && html`<p class="small muted">${words.next} <a href=${stepHref('colours')}>${t.setup.colours.title}</a></p>`}
    <${ViewField} box=${box} onChange=${onChange} />
    <p class="small muted">${words.trocars}</p>`;
}

/** Sizes alone are saved without painting again. @param {Props} props */
function SaveSizes({ box, tools, onChange }) {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const save = async () => {
    setBusy(true);
    setProblem(null);
    const sizes = tools.map(toolEntry).map(({ tool, diameter_mm, band_length_mm, marker }) => ({ tool, diameter_mm, band_length_mm, marker }));
    await api.boxes.resizeTools(box.id, { tools: sizes }).then(onChange, error => setProblem(asProblem(error)));
    setBusy(false);
  };
  return html`
    <${Notice} tone="warn" quiet title=${words.resized}>${words.resizedBody}<//>
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    <div class="row"><button class="button main" type="button" disabled=${busy} onClick=${save}>${busy ? t.form.saving
      : words.saveSizes}</button></div>`;
}

const How = ({ picture, lines }) => html`
  <div class="setup-two">
    <${picture} />
    <ul class="bullets">${lines.map(line => html`<li key=${line}>${line}</li>`)}</ul>
  </div>`;

const Known = ({ tools, onTake }) => html`
  <${Notice} tone="good" quiet title=${words.known(tools.map(({ name }) => name))}>${words.knownBody}<//>
  <div class="row"><button class="button" type="button" onClick=${onTake}>${words.change}</button></div>`;

/** `isFree`: whether the tool may be bare. */
function Tool({ tool, number, isFree, onKind, onChange, onRemove }) {
  const called = tool.name || (isBare(tool) ? t.box.sides[tool.side] : tool.tape) || words.numbered(number);
  const kinds = Object.entries(words.kinds).filter(([kind]) => kind === 'tape' || isFree);
  const text = name => event => onChange({ [name]: event.target.value });
  const size = name => ({ target }) => onChange({ [name]: sizeIn(target) });
  return html`
    <li>
      <fieldset class="instrument">
        <legend>${called}</legend>
        <div class="fields">
          <${Field} label=${words.kind} hint=${words.kindHint} type="select" value=${isBare(tool) ? 'bare' : 'tape'}
            options=${kinds} onInput=${event => onKind(event.target.value === 'bare')} />
        </div>
        <${isBare(tool) ? BareFields : TapeFields} tool=${tool} text=${text} size=${size} onChange=${onChange} />
        <button class="button bare" type="button" aria-label=${words.removeNamed(called)} onClick=${onRemove}>${t.setup.photos.remove}</button>
      </fieldset>
    </li>`;
}

/** The entered size, mm; undefined while it is empty or no number. */
const sizeIn = input => (input.value && !input.validity.badInput ? Number(input.value) : undefined);

/** A field for a size that says at once which sizes are possible, and why. @param {Props} props */
function SizeField({ range, reason, value, onInput, ...more }) {
  const [wrong, setWrong] = useState(Number.isFinite(value) && (value < range[0] || value > range[1]));
  const input = event => {
    const { rangeUnderflow, rangeOverflow } = event.target.validity;
    setWrong(rangeUnderflow || rangeOverflow);
    onInput(event);
  };
  return html`<${Field} type="number" step="any" min=${range[0]} max=${range[1]} value=${value} onInput=${input}
    error=${wrong ? { text: words.range(range[0], range[1], reason) } : undefined} ...${more} />`;
}

const TapeFields = ({ tool, text, size }) => html`
  <div class="fields">
    <${Field} label=${words.tape} hint=${words.tapeHint} required list="tapes" maxlength="40" value=${tool.tape} onInput=${text('tape')} />
    <${Field} label=${words.name} hint=${words.nameHint} optional maxlength="60" value=${tool.name} onInput=${text('name')} />
    <${SizeField} label=${words.diameter} hint=${words.diameterHint} required range=${DIAMETER_MM}
      reason=${words.ranges.diameter} value=${tool.diameter} onInput=${size('diameter')} />
    <${SizeField} label=${words.band} hint=${words.bandHint} optional range=${BAND_MM} reason=${words.ranges.band}
      value=${tool.band} onInput=${size('band')} />
    <${Field} label=${t.box.hand} hint=${words.sideHint} type="select" value=${tool.side}
      options=${[['', words.anySide], ...Object.entries(t.box.sides)]} onInput=${text('side')} />
  </div>`;

function BareFields({ tool, text, size, onChange }) {
  const { marker } = tool;
  // Fixed at first: it must not close around the field that is being emptied.
  const [opened] = useState((marker.collar_mm ?? marker.jaw_mm ?? null) !== null);
  const length = name => ({ target }) =>
    onChange({ marker: { ...marker, [name]: target.value && target.validity.valid ? Number(target.value) : undefined } });
  return html`
    <div class="fields">
      <${Field} label=${t.box.hand} hint=${words.bare.sideHint} type="select" value=${tool.side}
        options=${Object.entries(t.box.sides)} onInput=${text('side')} />
      <${SizeField} label=${words.bare.diameter} hint=${words.bare.diameterHint} required range=${DIAMETER_MM}
        reason=${words.ranges.diameter} value=${tool.diameter} onInput=${size('diameter')} />
      <${Field} label=${words.name} hint=${words.bare.nameHint} optional maxlength="60" value=${tool.name} onInput=${text('name')} />
    </div>
    <details open=${opened}>
      <summary>${words.bare.exact}</summary>
      <div class="fields">
        <${Field} label=${words.bare.collar} hint=${words.bare.collarHint} type="number" optional step="any" min="0.1"
          max="100" value=${marker.collar_mm} onInput=${length('collar_mm')} />
        <${Field} label=${words.bare.jaw} hint=${words.bare.jawHint} type="number" optional step="any" min="0"
          max="100" value=${marker.jaw_mm} onInput=${length('jaw_mm')} />
      </div>
    </details>`;
}

/** The one setting here that belongs to the box itself; it is saved at once. @param {Props} props */
function ViewField({ box, onChange }) {
  const [problem, setProblem] = useState(null);
  const change = event => api.boxes.change(box.id, { view: event.target.value }).then(onChange, error => setProblem(asProblem(error)));
  const known = Object.entries(t.boxes.views);
  const options = box.view ? known : [['', t.boxes.auto], ...known]; // Once set, it cannot be unset, only changed.
  return html`
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
    <div class="fields"><${Field} label=${t.boxes.view} hint=${words.viewHint} type="select" value=${box.view ?? ''}
      options=${options} onInput=${change} /></div>`;
}
