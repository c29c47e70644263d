/**
 * How many points are drawn: fewer while frames come too slowly, more again while there is time to spare.
 *
 * A count that was too much is not tried again, so the picture does not flicker between two sizes.
 */
export const SLOW_FPS = 24;
const QUICK_FPS = 50;
const FEWEST = 2000;
const LESS = 0.6;
const MORE = 1.3;

/** `next(fps)` with the rate of the last second gives the count to draw from now on. */
export function adaptive(all, start = all) {
  let shown = Math.min(all, start);
  let ceiling = all;
  return {
    get shown() {
      return shown;
    },
    next(fps) {
      if (fps < SLOW_FPS && shown > FEWEST) {
        ceiling = Math.max(FEWEST, Math.floor(shown * 0.95));
        shown = Math.max(FEWEST, Math.floor(shown * Math.max(LESS, Math.min(0.9, fps / SLOW_FPS))));
      } else if (fps > QUICK_FPS && shown < ceiling) {
        shown = Math.min(ceiling, Math.floor(shown * MORE));
      }
      return Math.min(shown, all);
    },
  };
}
