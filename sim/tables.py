"""Results as tables of pandas, where it is installed."""

from collections.abc import Mapping, Sequence
from typing import Any


def data_frame(columns: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> Any:
    """Columns by name, or rows as mappings -> DataFrame; ImportError where pandas is missing."""
    try:
        import pandas
    except ImportError:
        raise ImportError("to_pandas needs pandas: pip install pandas") from None
    return pandas.DataFrame(columns)
