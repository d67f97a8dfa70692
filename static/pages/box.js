// One box: its camera and the colours of its tools, each with both ways to provide them, and its self-test.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { number } from '../format.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { AgentCard, SelfTestNeed } from '../parts/boxes/box_agent.js';
import { BoxVersions, inUseFirst } from '../parts/boxes/box_versions.js';
import { CameraForms, CameraSummary } from '../parts/boxes/box_camera.js';
import { PaletteAdvice } from '../parts/boxes/box_advice.js';
import { PaletteForm, PaletteSummary } from '../parts/boxes/box_palette.js';
import { SelfTestForm, SelfTestSummary, TodaysLight } from '../parts/boxes/box_self_test.js';
import { RowButtons, saveChanges, useEditing } from '../parts/forms/editing.js';
import { ownerGroups } from '../parts/forms/owners.js';
import { MergedNotice, RecordMerges } from '../parts/people/record_merges.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { isBare } from '../setup/marks.js';
import { boxFields, CameraState, PaletteState, tokenWarning } from './boxes.js';

const words = t.box;

/** @param {Props} props */
export default function BoxPage({ person, route }) {
  const { id } = route.params;
  const {
    data: box,
    problem,
    reload,
  } = useData(
    async signal => {
      const found = await api.boxes.get(id, signal);
      const [camera, palettes, calibrations, selfTests, groups] = await Promise.all([
        found.calibration && api.boxes.camera(id),
        api.boxes.palettes(id),
        api.boxes.calibrations(id),
        api.boxes.selfTests(id),
        ownerGroups(person),
      ]);
      return { ...found, camera, palettes: inUseFirst(palettes), calibrations, selfTests, allGroups: groups };
    },
    [id],
  );
  const mayEdit = box?.may_change;
  const edit = useEditing({
    editTitle: t.boxes.edit,
    fields: boxFields(box?.allGroups ?? [], person),
    save: (item, values) => saveChanges(api.boxes, item, values),
    onChange: reload,
  });

  if (!box)
    return html`<${PageHead} title=${t.nav.boxes} />${problem
      ? html`<${ProblemNotice} problem=${problem} onRetry=${reload} />` : html`<${Loading} />`}`;
  const isReady = box.calibration && box.palette;
  const hasTape = !box.tools.length || !box.tools.every(isBare);
  return html`
    <${PageHead} title=${box.name} lead=${[box.code, box.view && t.boxes.views[box.view], box.notes].filter(Boolean).join(' · ')}>
      ${mayEdit && html`<a class=${`button ${isReady ? '' : 'main'}`} href=${href(['boxes', box.id, 'setup'])}>${t.setup.open}</a>`}
      <a class="button" href=${href(['record'], { box: box.id })}>${t.nav.record}</a>
      <a class="button" href=${href(['sessions'], { box: box.id })}>${t.sessions.title}</a>
      ${mayEdit && html`<${RowButtons} item=${box} onEdit=${edit.change} />`}
    <//>
    <div class="stack">
    <${SelfTestNeed} reasons=${box.self_test_reasons} />
    <${AgentCard} box=${box} person=${person} />
    <div class="steps">
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      <${MergedNotice} record=${box} opened=${id} />
      ${box.agent_token_expires_at && html`<${Notice} tone="warn" title=${tokenWarning(box)}>${t.boxes.tokenBody}<//>`}
      <${Readiness} box=${box} ready=${isReady} palette=${box.palettes[0]} mayEdit=${mayEdit} />
      <section class="card">
        <header><h2>${words.camera}</h2><${CameraState} calibration=${box.calibration} /></header>
        <div class="body stack">
          <${CameraSummary} camera=${box.camera} calibration=${box.calibration} />
          <${BoxVersions} title=${words.history} box=${box} versions=${box.calibrations} mayEdit=${mayEdit}
            change=${api.boxes.dateCalibration} onChange=${reload} more=${one => one.rms_px !== null && `${words.rms} ${number(one.rms_px)} px`} />
          ${mayEdit && html`<${CameraForms} box=${box} onChange=${reload} />`}
        </div>
      </section>
      <section class="card">
        <header><h2>${words.palette}</h2><${PaletteState} palette=${box.palette} /></header>
        <div class="body stack">
          <${PaletteSummary} palette=${box.palettes[0]} />
          <${BoxVersions} title=${words.paletteHistory} box=${box} versions=${box.palettes} mayEdit=${mayEdit}
            change=${api.boxes.datePalette} onChange=${reload} />
          ${mayEdit && hasTape && html`<${PaletteAdvice} box=${box} />`}
          ${mayEdit && html`<${PaletteForm} box=${box} onChange=${reload} />`}
        </div>
      </section>
      <section class="card">
        <header><h2>${t.selfTest.title}</h2><${TodaysLight} test=${box.self_test} /></header>
        <div class="body stack">
          <${SelfTestSummary} box=${box} tests=${box.selfTests} />
          ${may(person, 'edit_boxes') && box.calibration && box.palette && html`<${SelfTestForm} box=${box} camera=${box.camera}
            isFirst=${box.selfTests.length === 0} onChange=${reload} />`}
        </div>
      </section>
      ${may(person, 'people') && html`<${RecordMerges} kind="box" record=${box} onChange=${reload} />`}
    </div>
    </div>
    ${edit.dialogs}`;
}

/** A box that is ready may still have a tape that gives useless scores. @param {Props} props */
const Readiness = ({ box, ready, palette, mayEdit }) => {
  const bad = (palette?.verdicts ?? []).filter(({ grade }) => grade === 'bad').map(({ tool }) => tool);
  const link = mayEdit && html`<a href=${href(['boxes', box.id, 'setup'])}>${t.setup.open}</a>`;
  if (!ready) return html`<${Notice} tone="warn" title=${words.needed}>${link}<//>`;
  if (bad.length) return html`<${Notice} tone="warn" title=${words.readyBut(bad)} />`;
  return html`<${Notice} tone="good" title=${words.ready} />`;
};
