// The boxes, and what each box still needs before its recordings can be scored.
import { html } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { date, number } from '../format.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { AgentPill, useAgents } from '../parts/boxes/box_agent.js';
import { TodaysLight } from '../parts/boxes/box_self_test.js';
import { AddButton, RowButtons, saveChanges, useEditing } from '../parts/forms/editing.js';
import { ownerGroups, ownersField } from '../parts/forms/owners.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.boxes;

/** @param {Schemas['GroupResponse'][]} groups @param {Schemas['Me']} person */
export const boxFields = (groups, person) => item => [
  { name: 'name', label: words.name, required: true, maxlength: 100, value: item?.name },
  { name: 'code', label: words.code, hint: t.trainees.codeHint, maxlength: 60, value: item?.code },
  {
    name: 'view',
    label: words.view,
    type: 'select',
    options: [['', words.auto], ...Object.entries(words.views)],
    value: item?.view,
  },
  { name: 'notes', label: words.notes, type: 'textarea', value: item?.notes },
  ...ownersField(groups, item, person),
];

/** @param {Props} props */
export default function Boxes({ person }) {
  const { data, problem, reload } = useData(async () => {
    const [boxes, groups] = await Promise.all([api.boxes.all(), ownerGroups(person)]);
    return { boxes, groups };
  }, []);
  const agents = useAgents();
  const boxes = data?.boxes;
  const mayEdit = may(person, 'edit_boxes');
  const edit = useEditing({
    addTitle: words.add,
    editTitle: words.edit,
    removeTitle: t.people.removeTitle,
    fields: boxFields(data?.groups ?? [], person),
    save: (item, values) => saveChanges(api.boxes, item, values),
    remove: item => api.boxes.remove(item.id),
    onChange: reload,
  });
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>${mayEdit && data && html`<${AddButton} label=${words.add}
      onClick=${edit.add} />`}<//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    <section class="card">
      ${!boxes && !problem && html`<${Loading} />`}
      ${boxes?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${boxes && boxes.length > 0 && html`
        <div class="scroll">
          <table class="table">
            <thead><tr><th scope="col">${words.name}</th><th scope="col">${t.boxAgent.now}</th><th scope="col">${words.camera}</th><th scope="col">
              ${words.palette}</th><th scope="col">${t.selfTest.today}</th>
              <th scope="col" class="third">${words.tools}</th><th scope="col" class="third">${words.view}</th>
              <td></td></tr></thead>
            <tbody>
              ${boxes.map(box => html`
                <tr key=${box.id}>
                  <th scope="row"><a class="cover" href=${href(['boxes', box.id])}>${box.name}</a>${box.agent_token_expires_at && html`
                    <span class=${`pill ${hasExpired(box) ? 'bad' : 'warn'}`}>${tokenWarning(box)}</span>`}</th>
                  <td>${agents && html`<${AgentPill} agent=${agents.get(box.id)} />`}</td>
                  <td><${CameraState} calibration=${box.calibration} /></td>
                  <td><${PaletteState} palette=${box.palette} /></td>
                  <td>${box.self_test_reasons.length ? html`<span class="pill warn">${t.boxAgent.selfTestShort}</span>` : html`<${TodaysLight} test=${box.self_test} />`}</td>
                  <td class="third">${box.tools.map(toolName).join(', ') || '–'}</td>
                  <td class="third">${(box.view && words.views[box.view]) ?? words.auto}</td>
                  <td>${box.may_change && html`<div class="row">${!(box.calibration && box.palette) && html`<a class="button main nowrap"
                    href=${href(['boxes', box.id, 'setup'])} aria-label=${t.setup.openNamed(box.name)}>${words.setUp}</a>`}
                    <${RowButtons} item=${box} onEdit=${edit.change}
                      onRemove=${may(person, 'people') && edit.remove} /></div>`}</td>
                </tr>`)}
            </tbody>
          </table>
        </div>`}
    </section>
    ${edit.dialogs}`;
}

const hasExpired = box => Date.parse(box.agent_token_expires_at) <= Date.now();

/** When the token of the box's agent expires or expired. @param {Schemas['BoxResponse']} box */
export const tokenWarning = box =>
  (hasExpired(box) ? words.tokenExpired : words.tokenExpires)(date(box.agent_token_expires_at));

/**
 * The tool's name, with its tape if that has another name.
 *
 * @param {Schemas['BoxTool']} tool
 */
const toolName = ({ name, colour }) => (colour ? `${name} (${colour})` : name);

/** A camera.json from elsewhere may have no residual. @param {Props} props */
export const CameraState = ({ calibration }) => {
  if (!calibration) return html`<span class="pill warn">${words.notYet}</span>`;
  return html`<span class=${`pill ${calibration.warnings.length ? 'warn' : 'good'}`}>${Number.isFinite(calibration.rms_px)
    ? words.calibrated(number(calibration.rms_px)) : words.given}</span>`;
};

export const PaletteState = ({ palette }) =>
  palette ? html`<span class="pill good">${words.ready}</span>` : html`<span class="pill warn">${words.notYet}</span>`;
