// Runs in words, the same in every place.

// How a run ended that did not reach its end, as in "ran away after 1.8 s".
export function endInWords(run) {
  return `ran away after ${(run.time.at(-1) - run.startTime).toFixed(1)} s`;
}
