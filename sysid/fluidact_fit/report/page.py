from typing import Any
document_page=result_page=write_document_html=write_html=None
