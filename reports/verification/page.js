// Hides rows that do not fit; without it the page shows them all.
(() => {
  const form = document.getElementById("filter");
  const count = form.querySelector("output");
  const rows = [...document.querySelectorAll("tr[data-status]")];
  const cases = [...document.querySelectorAll("tbody[data-kind]")];
  const texts = new Map(rows.map((row) => [
    row, `${row.id} ${row.parentNode.firstChild.textContent} ${row.textContent}`.toLowerCase(),
  ]));

  function apply() {
    const words = form.elements.text.value.toLowerCase().split(/\s+/).filter(Boolean);
    const kind = form.elements.kind.value;
    const statuses = new Set([...form.querySelectorAll(":checked")].map((box) => box.value));
    let shown = 0;
    for (const row of rows) {
      const fits = statuses.has(row.dataset.status)
        && (!kind || row.parentNode.dataset.kind === kind)
        && words.every((word) => texts.get(row).includes(word));
      row.hidden = !fits;
      shown += fits;
    }
    for (const one of cases) one.hidden = !one.querySelector("tr[data-status]:not([hidden])");
    for (const table of document.querySelectorAll("table.rows")) {
      table.parentNode.hidden = !table.querySelector("tbody:not([hidden])");
    }
    count.textContent = `${shown} of ${rows.length} rows`;
  }

  form.hidden = false;
  form.addEventListener("input", apply);
  form.addEventListener("submit", (event) => event.preventDefault());
  apply();
})();
