// Whether camera and ports are where they were in earlier recordings. The service judges it, as for the whole
// recording.
import { clock, fixed } from '../../format.js';
import { t } from '../../texts.js';

const words = t.watch.placement;

/**
 * What has moved, in words; null if nothing has, or if it is not known. A movement during this recording comes first: it
 * can be seen without earlier recordings.
 *
 * @param {{ placement: any, movedDuring: { mm: number, at_s: number } | null, track: { tools: { name: string }[] } | null }} watch
 */
export function placementFault({ placement, movedDuring, track }) {
  const tools = track?.tools ?? [];
  if (movedDuring) return { title: words.moved(fixed(movedDuring.mm, 0), clock(movedDuring.at_s, 0)), advice: words.movedAdvice };
  if (!placement) return null;
  if (placement.camera) return { title: words.camera(fixed(placement.camera.mm, 0)), advice: words.cameraAdvice };
  const moved = placement.ports.map((shift, index) => shift && words.port(tools[index]?.name, fixed(shift.mm, 0)));
  const faults = moved.filter(Boolean);
  return faults.length ? { title: faults.join(', '), advice: words.portAdvice } : null;
}
