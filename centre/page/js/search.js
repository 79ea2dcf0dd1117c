// SPDX-License-Identifier: GPL-3.0-or-later

// The place of the first whose number is greater, in order of these numbers; that behind the last, if none is.
export function firstBeyond(all, wanted, numberOf = (each) => each) {
  let [low, high] = [0, all.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numberOf(all[middle]) <= wanted) low = middle + 1;
    else high = middle;
  }
  return low;
}
