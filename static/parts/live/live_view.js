// A session while it arrives: picture, states of the tools, tips in space, features so far, light, camera position.
import { html, useEffect, useRef } from '../../preact.js';
import { clock, number, unit } from '../../format.js';
import { t } from '../../texts.js';
import { useLiveWatch } from '../../watch.js';
import { featureRows } from '../session/features.js';
import { Interrupted } from './interrupted.js';
import { icons } from '../page/icons.js';
import { lightFault } from './light.js';
import { LiveScreen } from './live_screen.js';
import { LiveSpace } from './live_space.js';
import { LiveTools } from './live_tools.js';
import { Empty, Notice } from '../page/notice.js';
import { placementFault } from './placement.js';

const words = t.watch;

/** `under(watch)` is shown below the picture. @param {Props} props */
export function LiveView({ session, under, onClosed }) {
  const watch = useLiveWatch(session.id, onClosed);
  const { track } = watch;
  return html`
    <div class=${`live-view ${watch.why ? 'alone' : ''}`}>
      <div class="stack">
        <section class="card">
          <${LiveScreen} watch=${watch} name=${words.picture(session.box?.name)} />
          <div class="live-bar">
            <${ConnectionPill} watch=${watch} />
            ${track && html`<div class="row">
              <${LightState} watch=${watch} /><${PlacementState} watch=${watch} /><${LearningBox} watch=${watch} />
            </div>`}
            <${Elapsed} watch=${watch} />
          </div>
        </section>
        ${under(watch)}
        <${Interrupted} session=${session} watch=${watch} />
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

/** The state of the connection, in one word. @param {Props} props */
export function ConnectionPill({ watch: { state, why, track } }) {
  const liveState = why ? 'untracked' : track?.frames ? 'live' : 'begins';
  const connection = state === 'live' ? liveState : state;
  return html`<span class=${`pill ${TONES[connection] ?? ''}`}>${words.line[connection]}</span>`;
}

/** Whether the light is as it was at first. @param {Props} props */
export const LightState = ({ watch: { isFresh, light } }) => html`<${SteadyCheck} icon=${icons.sun} fault=${isFresh && lightFault(light)}
  steadyText=${words.light[isFresh && light ? 'steady' : 'unknown']} />`;

/** Whether camera and ports are where they were in earlier recordings. @param {Props} props */
export const PlacementState = ({ watch }) => html`<${SteadyCheck} icon=${icons.camera}
  fault=${watch.isFresh && placementFault(watch)}
  steadyText=${words.placement[watch.isFresh && watch.placement ? 'steady' : 'unknown']} />`;

/** That the box behind tools without tape is still being learned. @param {Props} props */
export const LearningBox = ({ watch: { isFresh, isLearningBox } }) =>
  (isFresh && isLearningBox ? html`<${SteadyCheck} fault=${words.learningBox} />` : null);

/** One word on a condition that should stay as it is, or what is wrong with it. */
function SteadyCheck({ icon: Icon, fault, steadyText }) {
  if (!fault) return html`<span class="light small muted"><${Icon} size="18" />${steadyText}</span>`;
  return html`<span class="light notice warn" role="status"><${icons.warning} /><span><strong>${fault.title}</strong>
    ${' '}<span class="small">${fault.advice}</span></span></span>`;
}

/** The length of the recording so far. @param {Props} props */
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

/** Features by tool. Too little data is said in words: a zero would be wrong. */
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
            ${tools.map(tool => html`<td key=${tool} class="number">${liveValue(row.byTool.get(tool)?.value)}</td>`)}
            <td class="unit">${unit(row.unit)}</td>
          </tr>`)}
      </tbody>
    </table>`;
}

const liveValue = value =>
  Number.isFinite(value) ? number(value) : html`<span class="not-enough">${words.tooLittle}</span>`;
