"""Packs the extension for VS Code: build/islandgp-bt.vsix.

python plugins/editor/pack.py
"""

from __future__ import annotations

import json
from pathlib import Path
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

FOLDER = Path(__file__).parent / "vscode"
PACKED = FOLDER.parents[2] / "build" / "islandgp-bt.vsix"

CONTENT_TYPES = """<?xml version="1.0" encoding="utf-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension=".json" ContentType="application/json"/>
<Default Extension=".js" ContentType="application/javascript"/>
<Default Extension=".vsixmanifest" ContentType="text/xml"/>
</Types>
"""

MANIFEST = """<?xml version="1.0" encoding="utf-8"?>
<PackageManifest Version="2.0.0" xmlns="http://schemas.microsoft.com/developer/vsx-schema/2011">
<Metadata>
<Identity Language="en-US" Id={name} Version={version} Publisher={publisher}/>
<DisplayName>{displayName}</DisplayName>
<Description xml:space="preserve">{description}</Description>
<Categories>Programming Languages</Categories>
<Properties><Property Id="Microsoft.VisualStudio.Code.Engine" Value={engine}/></Properties>
</Metadata>
<Installation><InstallationTarget Id="Microsoft.VisualStudio.Code"/></Installation>
<Dependencies/>
<Assets>
<Asset Type="Microsoft.VisualStudio.Code.Manifest" Path="extension/package.json"
 Addressable="true"/>
</Assets>
</PackageManifest>
"""


def pack(packed: Path) -> None:
    """Write the extension as a .vsix; the same bytes for the same files."""
    about = json.loads((FOLDER / "package.json").read_text(encoding="utf-8"))
    attributes = {key: quoteattr(about[key]) for key in ("name", "version", "publisher")}
    manifest = MANIFEST.format(
        **{**about, **attributes}, engine=quoteattr(about["engines"]["vscode"])
    )
    files = {
        "[Content_Types].xml": CONTENT_TYPES.encode(),
        "extension.vsixmanifest": manifest.encode(),
    }
    for file in sorted(FOLDER.rglob("*")):
        if file.is_file():
            files[f"extension/{file.relative_to(FOLDER).as_posix()}"] = file.read_bytes()
    packed.parent.mkdir(parents=True, exist_ok=True)
    with ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(ZipInfo(name), content, compress_type=ZIP_DEFLATED)


if __name__ == "__main__":
    pack(PACKED)
    print(PACKED)
