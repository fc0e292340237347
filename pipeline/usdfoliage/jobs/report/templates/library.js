"use strict";
{
  const form = document.querySelector(".tools"), list = document.querySelector(".tiles");
  const find = document.getElementById("find"), sort = document.getElementById("sort");
  const turn = document.getElementById("turn"), left = document.getElementById("left");
  const states = [...form.querySelectorAll("input[type=checkbox]")];
  const tiles = [...list.children];
  const plain = (text) => text.normalize("NFKD").replace(/\p{M}/gu, "").toLowerCase();
  const texts = new Map(tiles.map((tile) => [tile, plain(tile.querySelector(".about").textContent)]));
  /* data-name is a plant's number in the order of names. Heights and counts are negative: the largest comes first. */
  const keys = {
    name: (tile) => Number(tile.dataset.name),
    state: (tile) => Number(tile.dataset.rank),
    height: (tile) => ("height" in tile.dataset ? -Number(tile.dataset.height) : NaN),
    leaves: (tile) => ("leaves" in tile.dataset ? -Number(tile.dataset.leaves) : NaN),
    size: (tile) => ("size" in tile.dataset ? -Number(tile.dataset.size) : NaN),
  };
  const arrange = () => {
    const key = keys[sort.value], sign = turn.getAttribute("aria-pressed") === "true" ? -1 : 1;
    const ordered = [...tiles].sort((one, other) => {
      const first = key(one), second = key(other);
      /* What has no number comes last, whichever way. */
      if (Number.isNaN(first) !== Number.isNaN(second)) return Number.isNaN(first) ? 1 : -1;
      return sign * (first - second) || keys.name(one) - keys.name(other);
    });
    list.append(...ordered);
  };
  const sift = () => {
    const words = plain(find.value).split(/\s+/).filter(Boolean);
    const wanted = new Set(states.filter((state) => state.checked).map((state) => state.value));
    let count = 0;
    for (const tile of tiles) {
      const text = texts.get(tile);
      const fits = wanted.has(tile.dataset.state) && words.every((word) => text.includes(word));
      tile.hidden = !fits;
      count += fits;
    }
    left.textContent = count === tiles.length ? "" : count + " of " + tiles.length + " shown";
  };
  form.addEventListener("submit", (event) => event.preventDefault());
  find.addEventListener("input", sift);
  sort.addEventListener("change", arrange);
  turn.addEventListener("click", () => {
    turn.setAttribute("aria-pressed", String(turn.getAttribute("aria-pressed") !== "true"));
    arrange();
  });
  for (const state of states) state.addEventListener("change", sift);
  form.hidden = !tiles.length;
  arrange();
  sift();
}
