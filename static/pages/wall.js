// The wall: every recording that arrives now, each as a tile that leads to its page.
import { html } from '../parts/preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { number } from '../format.js';
import { useLive } from '../live.js';
import { href } from '../router.js';
import { language, t } from '../texts.js';
import { useWatch } from '../watch.js';
import { LiveScreen } from '../parts/live_screen.js';
import { stateOf, ToolState, useToolStates } from '../parts/live_tools.js';
import { Elapsed, Line } from '../parts/live_view.js';
import { lightFault } from '../parts/light.js';
import { Announce, Empty, Loading, PageHead, ProblemNotice } from '../parts/notice.js';
import { placementFault } from '../parts/placement.js';
import { ToolMark } from '../parts/readouts.js';

const words = t.wall;
const MOST = 24; // Pictures that one screen can show, and one device draw.
const TILE = { tip: true, borders: true };

export default function Wall() {
  const { data, problem, reload } = useData(
    signal => api.sessions.page({ status: 'receiving', limit: MOST }, signal),
    [],
  );
  const soon = useThrottled(reload, 700);
  useLive('session', soon);
  useLive('resync', reload);
  // Each box keeps its place, whoever else begins or ends.
  const items = [...(data?.items ?? [])].sort((a, b) => (a.box?.name ?? '').localeCompare(b.box?.name ?? '', language));
  return html`
    <${PageHead} title=${words.title} lead=${words.lead} />
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    <${Announce}>${data && words.count(items.length)}<//>
    ${!data && !problem && html`<${Loading} />`}
    ${data && items.length === 0 && html`<section class="card"><${Empty} title=${words.none} body=${words.noneBody}>
      <a class="button" href=${href(['boxes'])}>${words.boxes}</a><//></section>`}
    <div class="wall">
      ${items.map(session => html`<${Tile} key=${session.id} session=${session} onClosed=${soon} />`)}
    </div>
    ${data?.next && html`<p class="muted">${words.more(MOST)}</p>`}`;
}

function Tile({ session, onClosed }) {
  const watch = useWatch(session.id, onClosed);
  useToolStates(watch);
  const faults = [lightFault(watch.light), placementFault(watch.placement, watch.track?.tools ?? [])].filter(Boolean);
  return html`
    <article class="card tile">
      <${LiveScreen} watch=${watch} name=${t.watch.picture(session.box?.name)} show=${TILE} />
      <div class="body stack tight">
        <div class="row apart">
          <h2><a class="whole" href=${href(['sessions', session.id])}>${session.trainee?.name}</a></h2>
          <${Elapsed} watch=${watch} />
        </div>
        <div class="row apart small muted">
          <span>${session.task?.name} · ${session.box?.name}</span>
          <${Line} watch=${watch} />
        </div>
        <ul>${watch.track?.tools.map(tool => html`<${ToolLine} key=${tool.name} tool=${tool} watch=${watch} />`)}</ul>
        ${faults.map(({ title }) => html`<p key=${title} class="small fault">${title}</p>`)}
      </div>
    </article>`;
}

function ToolLine({ tool, watch }) {
  const path = watch.features.find(feature => feature.name === 'path_length' && feature.tool === tool.name);
  return html`
    <li class="row apart">
      <span class="tool"><${ToolMark} tool=${tool} />${tool.name}</span>
      <span class="path small">${Number.isFinite(path?.value) ? html`${words.path} ${number(path.value)} ${path.unit}`
        : words.tooLittle}</span>
      <${ToolState} state=${stateOf(watch, tool)} />
    </li>`;
}
