"""Shares of the factors of a population in the error: Shapley effects and Sobol indices from given data."""

from __future__ import annotations

from harness.models.quantities import capital, listed
from harness.reporting.document import Block, Bullets, Picture, Prose, Sheet, plain, strong
from harness.study.given_data import FEWEST, MOST_PLAYERS
from harness.study.report.analysis import Analysis
from harness.study.report.population import Population
from harness.study.report.sections.sensitivity import NAMED, dots, in_table, told
from harness.study.report.sections.tolerance import uncontrolled
from harness.study.score_names import PENDING


def blocks(analysis: Analysis) -> list[Block]:
    """Return words, a figure and tables for each ``population`` design; else nothing."""
    content: list[Block] = []
    for findings in analysis.findings:
        if findings.design.sampling == "population":
            content += _design(analysis, findings.population)
    return content


def _design(analysis: Analysis, population: Population) -> list[Block]:
    design = population.design
    if design.count(PENDING):
        return [Prose(plain(f"Design “{design.name}” is not finished; shares need all of its points."))]
    if not any(own for row in population.shares for own in row):
        text = f"Shares of the factors need {FEWEST} points, scores of all of them, and errors that differ."
        return [Prose(plain(text))]
    content: list[Block] = [Bullets(_words(population)), Prose(plain(_rule(population)))]
    for target in range(len(design.targets)):
        if any(population.shares[target]):
            content += [_picture(analysis, population, target), *_tables(population, target)]
    return content


def in_short(population: Population) -> list[str]:
    """Say for each target which factors have the largest share in the error of the best estimator."""
    sentences = []
    for t, target in enumerate(population.design.targets):
        own = population.shares[t][population.best(t)]
        if own is None:
            continue
        large = [i for i in own.order[:NAMED] if own.shapley[i].lower > 0.005]
        parts = [f"{n} {100 * own.shapley[i].value:.0f} %" for n, i in zip(population.named(large), large, strict=True)]
        sentences.append(
            f"With {population.design.estimators[population.best(t)]}, the variance of the error of the {target.words} "
            + (f"is due to {listed(parts)}." if parts else "is due to none of the factors.")
        )
    return sentences


def _words(population: Population) -> list[str]:
    items = []
    for t, target in enumerate(population.design.targets):
        e = population.best(t)
        if (own := population.shares[t][e]) is None:
            continue
        parts = [f"{n} {told(own.shapley[i])}" for n, i in zip(population.named(own.order), own.order, strict=True)]
        text = (
            f"With {population.design.estimators[e]}, the Shapley effects in the error are {listed(parts)}; all "
            f"factors together explain {told(own.explained)}."
        )
        items.append(f"{strong(capital(target.words) + '.')} {plain(text)}")
    return items


def _rule(population: Population) -> str:
    design, attributes = population.design, population.design.data.attrs
    text = (
        f"From the {design.status.shape[3]} points of {population.scramblings} independent scramblings. The Shapley "
        "effect is the share of the variance of the RMSE that a factor adds to what others explain already, in the "
        "mean over all orders in which they could become known; it is shared between factors that depend on each "
        "other, and all effects add up to what the factors explain together. The rest is noise of the runs, and what "
        "the regression misses. The first-order index is the share that is gone once the factor alone is known, the "
        "total index the share that is left while it alone is unknown. Intervals are at 95 %, by Student's t over the "
        f"scramblings.{uncontrolled(design)}"
    )
    if len(population.groups) > MOST_PLAYERS:
        text += " Shapley effects are means over orders at random, which their intervals allow for."
    if (change := float(attributes.get("correlation_change", 0.0))) > 0:
        text += (
            " The correlations that were stated are impossible together; the nearest correlation matrix was taken, "
            f"which differs by up to {change:.2g}."
        )
    return text


def _picture(analysis: Analysis, population: Population, target: int) -> Picture:
    design, quantity = population.design, population.design.targets[target]
    order, rows = population.order(target), []
    for name, own in zip(design.estimators, population.shares[target], strict=True):
        if own is not None:
            rows.append((name, [own.shapley[i] for i in order], [own.first[i].value for i in order]))
    question = f"Which factors make the error of the {quantity.words} vary in the population?"
    svg = dots(analysis, rows, population.named(order), question, "share of the variance of the RMSE")
    caption = (
        f"Shares in the variance of the RMSE of {quantity.words}, design “{design.name}”, n = "
        f"{design.status[:, 0].size} runs of each estimator. Filled: Shapley effects with 95 % interval; "
        "open: first-order Sobol index."
    )
    return Picture(svg, caption, question)


def _tables(population: Population, target: int) -> list[Block]:
    design, words = population.design, population.design.targets[target].words
    order, sheets = population.order(target), list[Block]()
    kinds = (("shapley", "Shapley effects"), ("first", "First-order Sobol indices"), ("total", "Total Sobol indices"))
    for kind, name in kinds:
        columns = [None if own is None else getattr(own, kind) for own in population.shares[target]]
        if not any(columns):
            continue
        rows = [[label, *("–" if c is None else in_table(c[i]) for c in columns)]
                for label, i in zip(population.named(order), order, strict=True)]  # fmt: skip
        if kind == "shapley":
            explained = ["–" if own is None else in_table(own.explained) for own in population.shares[target]]
            rows.append(["all together", *explained])
        caption = f"{name} of the RMSE of {words} with 95 % intervals, design “{design.name}”."
        sheets.append(Sheet(["factor", *design.estimators], rows, caption))
    return sheets
