// The live overview: every recording that arrives now, as a tile that links to its page.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData, useThrottled } from '../data.js';
import { number } from '../format.js';
import { useLive } from '../live.js';
import { href } from '../router.js';
import { language, t } from '../texts.js';
import { useLiveWatch } from '../watch.js';
import { LiveScreen } from '../parts/live/live_screen.js';
import { ToolState, toolStateOf, useToolStates } from '../parts/live/live_tools.js';
import { ConnectionPill, Elapsed } from '../parts/live/live_view.js';
import { lightFault } from '../parts/live/light.js';
import { Announce, Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { placementFault } from '../parts/live/placement.js';
import { ToolMark } from '../parts/playback/readouts.js';

const words = t.wall;
const MAX_TILES = 24; // Pictures that one screen can show and one device can draw.
const TILE = { tip: true, borders: true };

export default function LiveOverview() {
  const { data, problem, reload } = useData(
    signal => api.sessions.page({ status: 'receiving', limit: MAX_TILES }, signal),
    [],
  );
  const reloadSoon = useThrottled(reload, 700);
  useLive('session', reloadSoon);
  useLive('resync', reload);
  // Sorted by box: a tile keeps its place when other recordings begin or end.
  const items = [...(data?.items ?? [])].sort((a, b) => (a.box?.name ?? '').localeCompare(b.box?.name ?? '', language));
  return html`
    <${PageHead} title=${words.title} lead=${words.lead} />
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    <${Announce}>${data && words.count(items.length)}<//>
    ${!data && !problem && html`<${Loading} />`}
    ${data && items.length === 0 && html`<section class="card"><${Empty} title=${words.none} body=${words.noneBody}>
      <a class="button" href=${href(['boxes'])}>${words.boxes}</a><//></section>`}
    <div class="wall">
      ${items.map(session => html`<${Tile} key=${session.id} session=${session} onClosed=${reloadSoon} />`)}
    </div>
    ${data?.next && html`<p class="muted">${words.more(MAX_TILES)}</p>`}`;
}

/** @param {Props} props */
function Tile({ session, onClosed }) {
  const watch = useLiveWatch(session.id, onClosed);
  useToolStates(watch);
  const learningBox = watch.isLearningBox ? t.watch.learningBox : null;
  const faults = [lightFault(watch.light), placementFault(watch), learningBox]
    .flatMap(fault => fault ?? []);
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
          <${ConnectionPill} watch=${watch} />
        </div>
        <ul>${watch.track?.tools.map(tool => html`<${ToolRow} key=${tool.name} tool=${tool} watch=${watch} />`)}</ul>
        ${faults.map(({ title }) => html`<p key=${title} class="small fault">${title}</p>`)}
      </div>
    </article>`;
}

/** @param {Props} props */
function ToolRow({ tool, watch }) {
  const path = watch.features.find(feature => feature.name === 'path_length' && feature.tool === tool.name);
  return html`
    <li class="row apart">
      <span class="tool"><${ToolMark} tool=${tool} />${tool.name}</span>
      <span class="path small">${Number.isFinite(path?.value) ? html`${words.path} ${number(path.value)} ${path.unit}`
        : words.tooLittle}</span>
      <${ToolState} state=${toolStateOf(watch, tool)} />
    </li>`;
}
