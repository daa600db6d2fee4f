"""Options that ask for the operator's page or the control socket, and what serves them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import click

from zeromethod.cli.output import several
from zeromethod.operating.table import Table
from zeromethod.page.address import LOOPBACK, USUAL_PORT, control_address, page_address
from zeromethod.page.process import PageProcess

view_option = click.option(
    "--view",
    is_flag=False,
    flag_value=f"{LOOPBACK}:{USUAL_PORT}",
    metavar="[HOST:PORT]",
    help="Serve the operator's page, by default to this machine only; the address is printed.",
)
control_option = click.option(
    "--control",
    metavar="ADDRESS",
    help="Serve programs that control the run: tcp://127.0.0.1:5557 or unix:PATH.",
)
page_options = several(view_option, control_option)


@contextmanager
def opened_page(
    view: str | None, control: str | None, table: Table, columns: tuple[str, ...] = ()
) -> Iterator[PageProcess | None]:
    """The page's server, whose addresses are printed; None where nothing was asked for. Raises InputError."""
    if view is None and control is None:
        yield None
        return
    at = None if view is None else page_address(view)
    where = None if control is None else control_address(control)
    with PageProcess(table, columns, view=at, control=where) as page:
        if page.url:
            click.echo(f"view: {page.url}", err=True)
            click.echo(f"view only: {page.view_only_url}", err=True)
        if page.control_address:
            token = "" if page.control_address.startswith("unix:") else f" token {page.tokens[0]}"
            click.echo(f"control: {page.control_address}{token}", err=True)
        yield page
