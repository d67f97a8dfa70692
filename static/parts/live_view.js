// A session while it arrives: picture, state of the tools, tips in space, features so far, light, place of the camera.
import { html, useEffect, useRef } from './preact.js';
import { clock, number, unit } from '../format.js';
import { t } from '../texts.js';
import { useWatch } from '../watch.js';
import { featureRows } from './features.js';
import { icons } from './icons.js';
import { lightFault } from './light.js';
import { LiveScreen } from './live_screen.js';
import { LiveSpace } from './live_space.js';
import { LiveTools } from './live_tools.js';
import { Empty, Notice } from './notice.js';
import { placementFault } from './placement.js';

const words = t.watch;

export function LiveView({ session, onClosed }) {
  const watch = useWatch(session.id, onClosed);
  const { track } = watch;
  return html`
    <div class=${`live-view ${watch.why ? 'alone' : ''}`}>
      <div class="stack">
        <section class="card">
          <${LiveScreen} watch=${watch} name=${words.picture(session.box?.name)} />
          <div class="live-bar">
            <${Line} watch=${watch} />
            ${track && html`<div class="row"><${Light} watch=${watch} /><${Placed} watch=${watch} /></div>`}
            <${Elapsed} watch=${watch} />
          </div>
        </section>
        ${watch.isBehind && html`<${Notice} tone="warn" title=${words.behind}>${words.behindBody}<//>`}
        ${!watch.why && html`<section class="card features">
          <header><h2>${words.features}</h2></header>
          <${LiveFeatures} features=${watch.features} />
        </section>`}
      </div>
      ${track && html`<div class="stack second">
        <${LiveTools} watch=${watch} />
        <${LiveSpace} watch=${watch} />
      </div>`}
    </div>`;
}

const TONES = { live: 'good', untracked: 'warn', waiting: 'warn', silent: 'warn', broken: 'bad', ended: 'busy' };

/** How the line stands, in one word. */
export function Line({ watch: { state, why, track } }) {
  const told = why ? 'untracked' : track?.frames ? 'live' : 'begins';
  const line = state === 'live' ? told : state;
  return html`<span class=${`pill ${TONES[line] ?? ''}`}>${words.line[line]}</span>`;
}

/** Whether the light is what it was at first. */
export const Light = ({ watch: { isFresh, light } }) => html`<${Steady} icon=${icons.sun} fault=${isFresh && lightFault(light)}
  told=${words.light[isFresh && light ? 'steady' : 'unknown']} />`;

/** Whether camera and ports are where they were in earlier recordings. */
export const Placed = ({ watch: { isFresh, placement, track } }) => html`<${Steady} icon=${icons.camera}
  fault=${isFresh && placementFault(placement, track.tools)}
  told=${words.placement[isFresh && placement ? 'steady' : 'unknown']} />`;

/** A word on what should stay as it is, or what is wrong with it. */
function Steady({ icon: Icon, fault, told }) {
  if (!fault) return html`<span class="light small muted"><${Icon} size="18" />${told}</span>`;
  return html`<span class="light notice warn" role="status"><${icons.warning} /><span><strong>${fault.title}</strong>
    ${' '}<span class="small">${fault.advice}</span></span></span>`;
}

/** How long the recording is by now. */
export function Elapsed({ watch }) {
  const element = useRef(null);
  useEffect(
    () =>
      watch.onTick(() => {
        const now = watch.track?.frames ? clock(watch.track.time, 0) : '';
        if (element.current.textContent !== now) element.current.textContent = now;
      }),
    [watch],
  );
  return html`<span class="elapsed" role="timer" aria-label=${words.elapsed} ref=${element}></span>`;
}

/** Features by tool. Too little to tell is said so: a zero would be a lie. */
export function LiveFeatures({ features }) {
  if (!features.length) return html`<${Empty} title=${words.noFeatures} body=${words.noFeaturesBody} />`;
  const tools = [...new Set(features.map(feature => feature.tool))];
  return html`
    <table class="table dense live-features">
      <thead>
        <tr>
          <th scope="col">${t.session.feature}</th>
          ${tools.map(tool => html`<th key=${tool} scope="col" class="number">${tool}</th>`)}
          <th scope="col" class="unit"><span class="unseen">${t.session.unit}</span></th>
        </tr>
      </thead>
      <tbody>
        ${featureRows(features).map(row => html`
          <tr key=${row.name}>
            <th scope="row">${row.title}</th>
            ${tools.map(tool => html`<td key=${tool} class="number">${told(row.byTool.get(tool)?.value)}</td>`)}
            <td class="unit">${unit(row.unit)}</td>
          </tr>`)}
      </tbody>
    </table>`;
}

const told = value =>
  Number.isFinite(value) ? number(value) : html`<span class="not-enough">${words.tooLittle}</span>`;
